"""A diagnosis that shows and writes itself, as ``wt.diagnose()`` returns it."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path

from rich.console import Console

from wt.diagnose.report import text
from wt.diagnose.report.write import write
from wt.diagnose.result import Diagnosis


@dataclass(frozen=True, eq=False, repr=False)
class Report(Diagnosis):
    """A :class:`~wt.diagnose.result.Diagnosis` for scripts and notebooks."""

    @classmethod
    def of(cls, diagnosis: Diagnosis) -> Report:
        """The same diagnosis."""
        return cls(**{f.name: getattr(diagnosis, f.name) for f in fields(diagnosis)})

    def write(self, out: str | Path) -> None:
        """Write the report, the patched model and the rest into a folder."""
        write(self, Path(out))

    def show(self) -> None:
        """Print the findings, on a terminal or in a notebook."""
        text.print_summary(self, Console())

    def __repr__(self) -> str:
        """The findings in plain sentences."""
        lines = [f"Diagnosis: {self.verdict}", *text.sentences(self), text.fit(self)]
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        """A short summary, which a notebook shows by itself."""
        return text.to_html(self)
