"""The one exception that a user is meant to read."""

import re

LONGEST_WORD, LONGEST_SENTENCE = 200, 2000
"""Characters of one word and of all; what an input repeats a thousand times is shown by its ends."""


class TwilightError(Exception):
    """What went wrong, in one sentence that names the file, the key and what is allowed.

    The command line prints the sentence and leaves with exit code 2; a library user may catch it.
    """

    def __init__(self, sentence: str = ""):
        one_line = " ".join(str(sentence).splitlines())
        text = re.sub(rf"\S{{{LONGEST_WORD + 1},}}", _ends, one_line)
        if len(text) > LONGEST_SENTENCE:
            text = f"{text[: LONGEST_SENTENCE * 3 // 4]} ... {text[-LONGEST_SENTENCE // 5 :]}"
        super().__init__(text)


def _ends(word: re.Match[str]) -> str:
    text = word[0]
    return f"{text[: LONGEST_WORD // 2]}...{text[-LONGEST_WORD // 4 :]}"
