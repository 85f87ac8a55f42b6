"""Errors that a person can act on: each says what was expected, what was found and what to do."""


class NoveltyError(Exception):
    """Base of every error that `novelty` raises on purpose."""


class InputError(NoveltyError):
    """A scan, a file or a manifest that cannot be used; the message names it and says why."""


class ConfigError(NoveltyError):
    """A configuration key or value that is not valid; the message names the nearest valid one."""


class MissingDependencyError(NoveltyError):
    """A library that this operation needs is not usable; the message gives the command that installs it."""
