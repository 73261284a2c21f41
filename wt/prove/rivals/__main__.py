"""``python -m wt.prove.rivals NAME MODEL RECORDING… --holdout RECORDING… --out DIR``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from wt.errors import WTError
from wt.prove.rivals import coulomb, sindy, sysid
from wt.prove.rivals.base import Claim, RivalTask, write

RIVALS: dict[str, Callable[[RivalTask], list[Claim]]] = {
    "sysid": sysid.every,
    "sysid-bic": sysid.bic,
    "sindy": sindy.claims,
    "coulomb": coulomb.claims,
}


def main(argv: Sequence[str] | None = None) -> int:
    """Let a rival work on a case; its answer is written in the form of a diagnosis."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("rival", choices=RIVALS)
    parser.add_argument("model", type=Path)
    parser.add_argument("fit", type=Path, nargs="+")
    parser.add_argument("--holdout", type=Path, nargs="+", required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seconds", type=float, default=600.0)
    args = parser.parse_args(argv)
    task = RivalTask(args.model, tuple(args.fit), tuple(args.holdout), args.seconds)
    try:
        write(task, RIVALS[args.rival](task), args.out)
    except WTError as error:
        print(f"error: {error}", file=sys.stderr)
        return error.exit_code
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
