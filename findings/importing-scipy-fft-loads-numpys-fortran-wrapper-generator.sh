#!/usr/bin/env bash
# One would guess: `import scipy.fft` loads a transform and numpy's arrays.
# What is so: its array-API layer runs `from numpy import *`, and numpy's `__all__` names its submodules, which are
# otherwise loaded when first used. So it loads numpy.f2py, which wraps Fortran, with the parser of Fortran, and
# numpy.testing with unittest: 92 of 247 ms of one import. Where charset_normalizer is installed, f2py loads it, too.
# Version: scipy 1.17.1, numpy 2.4.6. Source: scipy/_lib/array_api_compat/_internal.py (clone_module),
# numpy/__init__.py (__getattr__, __all__), numpy/f2py/crackfortran.py.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/python" -m pip install --quiet --no-compile --disable-pip-version-check scipy==1.17.1 numpy==2.4.6
cat > "$folder/loaded.py" <<'PY'
import sys
import time

import numpy

WATCHED = ("numpy.f2py", "numpy.f2py.crackfortran", "numpy.testing", "unittest")
print("after import numpy:    ", [name for name in WATCHED if name in sys.modules])
began = time.process_time()
import scipy.fft

took = time.process_time() - began
loaded = [name for name in WATCHED if name in sys.modules]
print("after import scipy.fft:", loaded, f"in {1e3 * took:.0f} ms of CPU, {len(sys.modules)} modules")
sys.exit(loaded != list(WATCHED))
PY
"$folder/venv/bin/python" --version
"$folder/venv/bin/python" -m pip list --disable-pip-version-check 2> /dev/null | grep -iE "^(numpy|scipy) "
"$folder/venv/bin/python" "$folder/loaded.py"
