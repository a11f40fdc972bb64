#!/usr/bin/env bash
# One would guess: `from .drive import check`, where drive/__init__.py takes the function `check` from its module
# `check`, is that function, whatever else the package imports.
# What is so: while no circle of imports goes through drive/check.py, it is. One import that closes such a circle, in
# a file that has nothing to do with it, makes it the module: "Module not callable", in a file that was not changed.
# Under TYPE_CHECKING the import does not count. The program runs in all three cases.
# Version: mypy 2.4.1. Source: mypy's issues 7203 and 7419, open since 2019.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/python" -m pip install --quiet --no-compile --disable-pip-version-check mypy==2.4.1
cd "$folder"
mkdir -p lab/drive
touch lab/__init__.py
echo "from .check import check as check" > lab/drive/__init__.py
printf 'from .drive import check\n\n\ndef use() -> int:\n    return check(1)\n' > lab/use.py

# The module with the function, behind the lines that are given.
write() { printf '%s\n\n\ndef check(volts: int) -> int:\n    return volts\n' "$1" > lab/drive/check.py; }

# What mypy says, and what the program does.
look() {
    printf '%s:\n' "$1"
    "$folder/venv/bin/python" -c 'import lab.use; print("    runs, and gives", lab.use.use())'
    "$folder/venv/bin/python" -m mypy --no-incremental -p lab | sed 's/^/    /' | tee said || true
}

"$folder/venv/bin/python" -m mypy --version
write ""
look "no circle"
grep -q Success said
write $'from typing import TYPE_CHECKING\n\nif TYPE_CHECKING:\n    from .. import use'
look "a circle under TYPE_CHECKING"
grep -q Success said
write $'def later() -> int:\n    from .. import use\n\n    return use.use()'
look "a circle by an import within a function"
grep -q "lab/use.py:5: error: Module not callable" said
