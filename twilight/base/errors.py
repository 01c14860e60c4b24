"""The one exception and the one warning that a user is meant to read."""

import re
from collections.abc import Iterable

LONGEST_WORD = 200
"""Characters of one word of a sentence; of a longer one both ends are shown."""

LONGEST_SENTENCE = 800
"""Characters of a sentence; of a longer one both ends are shown."""


class TwilightError(Exception):
    """What went wrong, in one sentence that names the file, the key and what is allowed.

    The command line prints the sentence and leaves with exit code 2; a library user may catch it.
    """

    def __init__(self, sentence: str = ""):
        text = re.sub(rf"\S{{{LONGEST_WORD + 1},}}", lambda word: _ends(word[0], LONGEST_WORD), str(sentence))
        super().__init__(_ends(" ".join(text.split()), LONGEST_SENTENCE))


def check_known(key: str, name: object, known: Iterable[str]) -> None:
    """Raise TwilightError unless `name`, which a user gave for `key`, is one of those known."""
    if name not in (names := list(known)):
        raise TwilightError(f"{key}: '{name}' is not known, choose one of {', '.join(names)}")


class TwilightWarning(UserWarning):
    """What a user should know about a result that is given all the same, in one sentence.

    The command line prints the sentence; a library user may turn it into an error or silence it by this class.
    """


def _ends(text: str, longest: int) -> str:
    return text if len(text) <= longest else f"{text[: longest // 2]} ... {text[-longest // 2 :]}"
