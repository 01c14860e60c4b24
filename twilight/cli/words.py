"""Arguments as people type or paste them: the minus sign of texts, hemispheres, decimal commas, missing quotes."""

import re
from collections.abc import Sequence

MINUS = "−"
"""The minus sign of Unicode, which word processors and web pages have for a hyphen."""
_NUMBERS = re.compile(rf"(?P<key>(?:--)?[\w.-]+=)?(?P<value>[\[({MINUS}+-]*[\d.][\d.,:eE\s{MINUS}+\-\])]*[NSEWnsew]?)")
_DEGREES = re.compile(r"(\d+(?:\.\d*)?)\s*°?\s*([NSEWnsew])")
_HEMISPHERES = {"--latitude": "NS", "--longitude": "EW"}
QUOTES = "; words that belong together need quotes, e.g. --at '2026-06-21 civil dusk'"
"""Added to an error of words that are too many: the shell has cut an argument at its spaces."""


def as_meant(arguments: Sequence[str]) -> list[str]:
    """Arguments with the hyphen for the minus sign of numbers, and a sign for the hemisphere of an angle (52.5N)."""
    meant: list[str] = []
    for text in arguments:
        if MINUS in text and _NUMBERS.fullmatch(text):
            text = text.replace(MINUS, "-")
        option, equals, value = text.partition("=") if text.startswith("--") else (meant[-1] if meant else "", "", text)
        sides = _HEMISPHERES.get(option, "")
        found = _DEGREES.fullmatch(value.strip())
        if found and found[2].upper() in sides:
            sign = "-" if found[2].upper() == sides[1] else ""
            text = f"{option}{equals}{sign}{found[1]}" if equals else f"{sign}{found[1]}"
        meant.append(text)
    return meant


def perhaps_a_decimal_comma(text: str) -> bool:
    """Whether a list of two numbers may be one with a decimal comma."""
    return re.fullmatch(r"[+-]?\d{1,2},\d{1,3}", text.strip()) is not None
