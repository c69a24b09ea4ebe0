"""All benchmarks of speed, one after the other, and a table of their goals.

./run bench [NAME …] [--document docs/speed.md]
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

from stopwatch import Goal, goals_table, parser

NAMES = ("peers", "step", "limit", "ranks")


def main() -> None:
    """Run each in a process of its own, for their memory and kernels are looked at."""
    arguments = parser(__doc__)
    arguments.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(NAMES)}")
    options = arguments.parse_args()
    unknown = set(options.names) - set(NAMES)
    if unknown:
        arguments.error(f"{', '.join(sorted(unknown))}: there is {', '.join(NAMES)}")
    goals: list[Goal] = []
    more = ["--document", options.document] if options.document else []
    for name in options.names or NAMES:
        script = Path(__file__).with_name(f"{name}.py")
        print(f"== {name}", flush=True)
        subprocess.run([sys.executable, script, "--out", options.out, *more], check=True)
        content = json.loads((options.out / f"{name}.json").read_text(encoding="utf-8"))
        for goal in content["goals"]:
            del goal["met"]
            goals.append(Goal(**goal))
    print(*goals_table(goals), sep="\n")


if __name__ == "__main__":
    main()
