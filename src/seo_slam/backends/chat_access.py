"""Where a chat server is, and with which key. A key comes from the environment only, and is in nothing that is shown or kept."""

import ipaddress
import os
import re
from dataclasses import dataclass
from typing import NoReturn
from urllib.parse import urlsplit

from seo_slam.errors import ConfigError

_NAME_OF_VARIABLE = re.compile(r"[A-Z][A-Z0-9_]{0,39}")
_SHORTEST_SECRET = 8  # below it is a placeholder ("EMPTY") that may stand in any text


@dataclass(frozen=True, slots=True)
class ServerRules:
    """What is known of a hosted server.

    Attributes:
        suffix: its host name ends in it.
        key_env: environment variable of the key.
        key_header: the header that the key goes into.
        most_request_bytes: a longer request is refused there.
    """

    suffix: str
    key_env: str
    key_header: str = "Authorization"
    most_request_bytes: int | None = None


KNOWN_SERVERS = (
    ServerRules("api.openai.com", "OPENAI_API_KEY"),
    ServerRules("openai.azure.com", "AZURE_OPENAI_API_KEY", "api-key"),
    ServerRules("services.ai.azure.com", "AZURE_OPENAI_API_KEY", "api-key"),
    ServerRules("cognitiveservices.azure.com", "AZURE_OPENAI_API_KEY", "api-key"),
    ServerRules("api.groq.com", "GROQ_API_KEY", most_request_bytes=4_000_000),
    ServerRules("api.together.xyz", "TOGETHER_API_KEY"),
    ServerRules("openrouter.ai", "OPENROUTER_API_KEY"),
)


class ServerKey:
    """A key that does not show itself: not in ``repr``, not in a pickle, not in what passed ``hide``."""

    __slots__ = ("_secret", "variable")

    def __init__(self, variable: str, secret: str) -> None:
        """Take a key and the name of the variable it came from."""
        self.variable = variable
        self._secret = secret

    def __repr__(self) -> str:
        return f"<key from {self.variable}>"

    def __reduce__(self) -> NoReturn:
        raise TypeError("a key is not written into files; the environment has it")

    def headers(self, name: str) -> dict[str, str]:
        """Return the header that carries it."""
        return {name: f"Bearer {self._secret}" if name.lower() == "authorization" else self._secret}

    def hide(self, text: str) -> str:
        """Return a text without the key in it."""
        return text.replace(self._secret, f"[{self.variable}]") if len(self._secret) >= _SHORTEST_SECRET else text


@dataclass(frozen=True, slots=True)
class Access:
    """How a server is reached.

    Attributes:
        url: of chat completions.
        host: name and port, for messages.
        is_loopback: it is this machine.
        key: None: it takes none.
        key_header: the header that the key goes into.
        most_request_bytes: a longer request is not sent; None: any length.
    """

    url: str
    host: str
    is_loopback: bool
    key: ServerKey | None
    key_header: str
    most_request_bytes: int | None

    def headers(self) -> dict[str, str]:
        """Return the headers of every request."""
        plain = {"Content-Type": "application/json", "Accept": "application/json", "Accept-Encoding": "identity"}
        return plain | (self.key.headers(self.key_header) if self.key else {})

    def hide(self, text: str) -> str:
        """Return a text without the key in it."""
        return self.key.hide(text) if self.key else text


def access_to(base_url: str, api_key_env: str | None, api_key_header: str | None, max_request_bytes: int | None) -> Access:
    """Return the way to a server.

    Raises:
        ConfigError: the URL is none, or holds what belongs into the environment; the variable of the key is not set or holds no key.
    """
    url, host, name = _checked(base_url)
    rules = next((rules for rules in KNOWN_SERVERS if name == rules.suffix or name.endswith(f".{rules.suffix}")), None)
    variable = api_key_env or (rules.key_env if rules else None)
    header = api_key_header or (rules.key_header if rules else "Authorization")
    if not header.replace("-", "").isalnum() or not header.isascii():
        raise ConfigError(f"api_key_header: got {header!r:.60}, wanted the name of an HTTP header, such as 'api-key'")
    most = max_request_bytes or (rules.most_request_bytes if rules else None)
    return Access(url, host, _is_loopback(name), _key_in(variable, host) if variable else None, header, most)


def _checked(base_url: str) -> tuple[str, str, str]:
    """URL of chat completions, host with port, host name."""
    if not isinstance(base_url, str):
        raise ConfigError(f"base_url: got a {type(base_url).__name__}, wanted text such as 'http://127.0.0.1:11434/v1'")
    try:
        parts = urlsplit(base_url)
        name, port = parts.hostname, parts.port
    except ValueError as error:
        raise ConfigError(f"base_url: is no URL: {error}") from None
    if parts.username or parts.password or parts.query or parts.fragment:
        raise ConfigError("base_url: holds a user name, password or query; keys come from the environment, see api_key_env")
    if parts.scheme not in ("http", "https") or not name:
        raise ConfigError(f"base_url: got {base_url!r:.80}, wanted http:// or https:// with a host, such as 'http://127.0.0.1:11434/v1'")
    path = parts.path.rstrip("/").removesuffix("/chat/completions")
    return f"{parts.scheme}://{parts.netloc}{path}/chat/completions", f"{name}:{port}" if port else name, name.lower()


def _is_loopback(name: str) -> bool:
    try:
        return ipaddress.ip_address(name).is_loopback
    except ValueError:
        return name == "localhost" or name.endswith(".localhost")


def _key_in(variable: str, host: str) -> ServerKey:
    if variable not in os.environ and not _NAME_OF_VARIABLE.fullmatch(variable):
        # perhaps somebody wrote the key itself where its variable's name belongs: it must not be shown
        raise ConfigError("api_key_env: wanted the name of an environment variable, such as 'OPENAI_API_KEY', not the key itself")
    secret = os.environ.get(variable, "").strip()
    if not secret:
        raise ConfigError(f"the key of {host} is missing: set the environment variable {variable}, or name another one as api_key_env")
    if not secret.isascii() or not secret.isprintable() or " " in secret:
        raise ConfigError(f"the environment variable {variable} holds no key: there are spaces or other characters in it that no key has")
    return ServerKey(variable, secret)
