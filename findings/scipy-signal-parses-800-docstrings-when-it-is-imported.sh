#!/usr/bin/env bash
# One would guess: `import scipy.signal` runs definitions; texts for a reader cost a program nothing.
# What is so: since 1.16 a decorator adds a table of array libraries to the docstring of each public function:
#   numpydoc's parser takes 800 of them apart and writes them anew whenever a program starts, more than a third of the
#   import's processor time.
# Version: scipy 1.17.1 (1.15.3 parses 68), Python 3.11 on Linux.
# Source: scipy/_lib/_array_api.py, `xp_capabilities`; scipy/_lib/_docscrape.py.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cat > "$folder/count.py" <<'PYTHON'
import sys
import time

import scipy
from scipy._lib import _docscrape

count, spent, depth = 0, 0.0, 0
original = _docscrape.FunctionDoc.__init__


def counted(self, *words, **named):
    global count, spent
    count, began = count + 1, time.process_time()
    original(self, *words, **named)
    spent += time.process_time() - began


_docscrape.FunctionDoc.__init__ = counted
began = time.process_time()
import scipy.signal  # noqa: E402, F401

whole = time.process_time() - began
print(f"scipy {scipy.__version__}: {count} docstrings parsed in {spent / whole:.0%} of the import")
low, high = map(int, sys.argv[1:])
sys.exit(not low <= count <= high)
PYTHON
for version in 1.15.3 1.17.1; do
    python3 -m venv "$folder/$version"
    "$folder/$version/bin/python" -m pip install --quiet --disable-pip-version-check scipy==$version numpy==2.2.6
done
"$folder/1.15.3/bin/python" "$folder/count.py" 0 100
"$folder/1.17.1/bin/python" "$folder/count.py" 500 2000
