"""A proposed map as YAML that ``wt import --map`` reads, with its doubts as comments."""

from __future__ import annotations

from pathlib import Path

import yaml

from wt.data.guess.propose import Proposal

_ORDER = ("episode", "time", "columns", "joints", "commands", "sensors", "units", "signs")
_MOST = 40  # rows that are listed as left out


def text(proposal: Proposal, source: Path) -> str:
    """The map.

    Args:
        proposal: what is believed.
        source: what it is of, for the first line.
    """
    lines = [f"# What 'wt import --guess' believes of {_plain(source.name)}: see that it is right."]
    if proposal.doubts:
        lines.append("# Doubts:")
        lines += [f"#   - {_plain(doubt)}" for doubt in dict.fromkeys(proposal.doubts)]
    for key in _ORDER:
        if key not in proposal.mapping:
            continue
        value = proposal.mapping[key]
        if key in ("time", "episode"):
            lines.append(f"{key}: {_flow(value)}{_note(proposal, key, '')}")
            continue
        lines.append(f"{key}:")
        lines += [f"  {_flow(name)}: {_flow(entry)}{_note(proposal, key, name)}"
                  for name, entry in value.items()]  # fmt: skip
    if proposal.left_out:
        lines.append("# Left out:")
        for name, why in list(proposal.left_out.items())[:_MOST]:
            lines.append(f"#   {_plain(name)}: {_plain(why)}")
        if len(proposal.left_out) > _MOST:
            lines.append(f"#   … and {len(proposal.left_out) - _MOST} more")
    if not proposal.mapping:
        lines.append("{}  # the source says it all")
    return "\n".join(lines) + "\n"


def _note(proposal: Proposal, key: str, name: str) -> str:
    note = proposal.notes.get((key, name), "")
    return f"  # {_plain(note)}" if note else ""


def _flow(value: object) -> str:
    """A value as YAML in one line."""
    dumped = yaml.safe_dump(
        value, default_flow_style=True, width=10**6, allow_unicode=True, sort_keys=False
    )
    return dumped.removesuffix("\n").removesuffix("\n...")


def _plain(line: str) -> str:
    """A comment in one line, without signs that a terminal acts upon."""
    return "".join(c if c.isprintable() else " " for c in line)
