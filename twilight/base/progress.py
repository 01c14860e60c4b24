"""How work that takes long reports what fraction of it is done: one function of a few words and a fraction."""

from collections.abc import Callable

Progress = Callable[[str, float], None]
"""Called with a few words on what is being done and the fraction of the work that is done."""


def silent(doing: str, fraction: float) -> None:
    """A progress that reports nothing."""


class PhasedProgress:
    """A progress made of that of one phase of the work after another; its fraction of the whole never goes back."""

    def __init__(self, report: Progress):
        self.report = report
        self.label = ""
        self.done = self.start = self.span = 0.0

    def phase(self, label: str, start: float, span: float) -> None:
        """What is reported from here on is about a phase that is `span` of the whole and begins at `start`."""
        self.label, self.start, self.span = label, start, span
        self("", 0.0)

    def __call__(self, doing: str, fraction: float) -> None:
        self.done = max(self.done, self.start + self.span * min(max(fraction, 0.0), 1.0))
        self.report(f"{self.label} {doing}".strip(), self.done)


def part_of(progress: Progress, start: float, span: float, label: str = "") -> Progress:
    """The progress of a piece of work that is `span` of the whole from `start` on; `label` goes before its words."""

    def report(doing: str, fraction: float) -> None:
        progress(f"{label} {doing}".strip(), start + span * min(max(fraction, 0.0), 1.0))

    return report
