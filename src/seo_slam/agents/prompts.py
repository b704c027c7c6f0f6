"""The prompts, in files one can read: ``prompts/<name>.txt`` beside this file, the first line of each saying name and version."""

import hashlib
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

from seo_slam.errors import ConfigError

NAMES = ("verification", "description", "merging", "ask", "classes")


@dataclass(frozen=True, slots=True)
class Prompt:
    """A system prompt.

    Attributes:
        text: what the model is told.
        version: like "verification/1"; the number rises with every change of meaning.
        hash: the first 16 hexadecimal digits of the SHA-256 of the text; written beside every edit.
    """

    text: str
    version: str
    hash: str


@cache
def prompt(name: str) -> Prompt:
    """Return one of our prompts.

    Raises:
        ConfigError: there is none of that name.
    """
    if name not in NAMES:
        raise ConfigError(f"unknown prompt {name!r}; known: {', '.join(NAMES)}")
    whole = files("seo_slam.agents").joinpath("prompts", f"{name}.txt").read_text(encoding="utf-8")
    version, _, text = whole.replace("\r\n", "\n").partition("\n")
    return Prompt(text.strip(), version, hashlib.sha256(text.strip().encode()).hexdigest()[:16])
