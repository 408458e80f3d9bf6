"""The one family of errors: what went wrong, said so that a user can mend it."""


class PredplanError(Exception):
    """The work failed; the message says what and why (exit code 1)."""


class InputError(PredplanError):
    """Bad input or usage (exit code 2): the message names file, line or field, what was found and what was expected."""
