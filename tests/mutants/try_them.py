#!/usr/bin/env python3
"""Runs the test of each mutant in table.txt, in a build of a tree that mutate.py has edited:

    tests/mutants/try_them.py BUILD [MUTANT...]

Without a mutant each test must pass; with its own it must fail. Prints the results, and counts.
"""
import os
import subprocess
import sys
from pathlib import Path

TABLE = Path(__file__).with_name("table.txt")


def rows():
    for line in TABLE.read_text().splitlines():
        if line and not line.startswith("#"):
            number, what, program, names = (part.strip() for part in line.split(";"))
            yield int(number), what, program, names


def passes(program, names, mutant):
    environment = dict(os.environ, MUTANT=str(mutant))
    ran = subprocess.run([program, f"--gtest_filter={names}", "--gtest_fail_fast"], env=environment,
                         stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace")
    failed = [line.split()[3].rstrip(",") for line in ran.stdout.splitlines() if line.startswith("[  FAILED  ] ")
              and len(line.split()) > 3 and "." in line.split()[3]]
    if "Running 0 tests" in ran.stdout:
        sys.exit(f"{program} has no test {names}")
    return ran.returncode == 0, failed[0] if failed else "crashed" if ran.returncode else ""


def main():
    build, chosen = Path(sys.argv[1]), {int(word) for word in sys.argv[2:]}
    without, alive = {}, []
    for number, what, name, names in rows():
        if chosen and number not in chosen:
            continue
        program = next(build.glob(f"tests/*/{name}"))
        if (name, names) not in without:
            without[name, names] = passes(program, names, 0)
        if not without[name, names][0]:
            print(f"{number:3}  {what}: the test fails without it: {without[name, names][1]}", flush=True)
            continue
        survives, by = passes(program, names, number)
        if survives:
            alive.append(number)
        print(f"{number:3}  {what}: {'SURVIVES' if survives else 'killed by ' + by}", flush=True)
    print(f"{len(alive)} survive: {alive}")
    return bool(alive)


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    sys.exit(main())
