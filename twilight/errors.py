"""The one exception that a user is meant to read."""


class TwilightError(Exception):
    """What went wrong, in one sentence that names the file, the key and what is allowed.

    The command line prints the sentence and leaves with exit code 2; a library user may catch it.
    """
