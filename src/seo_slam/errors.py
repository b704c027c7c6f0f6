"""Every exception that seo_slam raises.

    SeoSlamError
      ConfigError(ValueError)          a setting is misspelt or out of range
      FrameError(ValueError)           an array handed in has a bad shape, type or value
      DatasetError                     a recording cannot be read; names file and line
      EvaluationError                  an estimate cannot be scored against this truth
      OptimizationError                the factor graph has no solution
      NoPathError                      no way leads there over the free floor that is known
      BackendError                     a plug-in cannot be used
        UnknownBackendError(LookupError)
        MissingBackendError(ImportError)   names the extra to install
      MapError
        UnknownLandmarkError(KeyError)
        EditRefused                    an agent's edit does not hold any more
        MapFormatError                 a map file of another schema, or cut off
      AgentError                       an agent could not answer; the map is unchanged
        ChatRequestError               no reply could be had: network, server, key
        ChatReplyError                 a reply came, and is not what was asked for
        BudgetExceeded                 tokens or money are spent; agents stop, the run goes on

The caller's mistake raises at once, before any state changes. The world's mistake (no depth, no detections, odometry lost)
never raises: it is a warning in ``StepResult``.
"""


class SeoSlamError(Exception):
    """Base class of all errors of this library."""


class ConfigError(SeoSlamError, ValueError):
    """A setting is unknown, misspelt or out of range."""


class FrameError(SeoSlamError, ValueError):
    """An array handed in has a bad shape, type or value."""


class DatasetError(SeoSlamError):
    """A recording or a file of one cannot be read."""


class EvaluationError(SeoSlamError):
    """An estimate cannot be scored against this truth."""


class OptimizationError(SeoSlamError):
    """The factor graph could not be solved."""


class NoPathError(SeoSlamError):
    """A planner found no collision-free way; a navigator takes it as an answer, not as its end."""


class BackendError(SeoSlamError):
    """A plug-in cannot be used."""


class UnknownBackendError(BackendError, LookupError):
    """No plug-in of that name is known."""


class MissingBackendError(BackendError, ImportError):
    """A plug-in is known, but a package it needs is not installed."""


class MapError(SeoSlamError):
    """Base class of errors about a map."""


class UnknownLandmarkError(MapError, KeyError):
    """No landmark has that id."""

    def __str__(self) -> str:  # KeyError would print the repr of the message
        return str(self.args[0]) if self.args else ""


class EditRefused(MapError):  # noqa: N818  # a verdict, not a fault
    """An edit names an old version of a landmark, or the geometry forbids it."""


class MapFormatError(MapError):
    """A map file has another schema, or is cut off or damaged."""


class AgentError(SeoSlamError):
    """An agent could not answer. The map is unchanged."""


class ChatRequestError(AgentError):
    """No reply could be had from a chat model.

    Attributes:
        permanent: asking again is of no use: the key is refused, the model is unknown.
    """

    def __init__(self, message: str, permanent: bool = False) -> None:
        super().__init__(message)
        self.permanent = permanent


class ChatReplyError(AgentError):
    """A chat model replied with something other than what was asked for."""


class BudgetExceeded(AgentError):  # noqa: N818  # a limit, not a fault
    """The tokens or the money set aside for a chat model are spent."""
