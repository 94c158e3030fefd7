"""The errors of a run directory."""


class RunError(Exception):
    """A run directory cannot be used as asked; the message says which, why, and what would be right."""


class OtherProgramError(RunError):
    """A run was begun with another kernel or classifier, whose results could differ."""
