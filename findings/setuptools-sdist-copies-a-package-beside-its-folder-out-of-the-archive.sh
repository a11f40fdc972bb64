#!/usr/bin/env bash
# One would guess: a package that `package_dir` takes from a folder beside the project ("../base") is in the source
#   distribution, as it is in the wheel, or building the distribution ends with an error.
# What is so: the archive lacks it, without a warning and with exit code 0. Its files are copied to "../base" of the
#   tree that becomes the archive, which is a new folder `base` in the project's own sources. A wheel of the folder
#   holds the package.
# Version: setuptools 80.9.0, Python 3.11 on Linux.
# Source: setuptools/_distutils/command/sdist.py, `make_release_tree`, which joins each listed name to the tree.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
python="$folder/venv/bin/python"
"$python" -m pip install --quiet --disable-pip-version-check setuptools==80.9.0 wheel==0.45.1
mkdir -p "$folder/clone/base" "$folder/clone/thing"
echo "HERE = True" > "$folder/clone/base/__init__.py"
echo "from . import base" > "$folder/clone/thing/__init__.py"
cat > "$folder/clone/thing/setup.py" <<'PYTHON'
from setuptools import setup

setup(
    name="thing",
    version="1.0",
    packages=["thing", "thing.base"],
    package_dir={"thing": ".", "thing.base": "../base"},
)
PYTHON
cd "$folder/clone/thing"
"$python" setup.py --quiet bdist_wheel 2> "$folder/warnings"
[ ! -e base ]
"$python" setup.py --quiet sdist 2>> "$folder/warnings"
wheel=$("$python" -m zipfile --list dist/thing-1.0-*.whl | grep -c "base/__init__.py" || true)
archive=$("$python" -m tarfile --list dist/thing-1.0.tar.gz | grep -c "base/__init__.py" || true)
echo "setuptools $("$python" -c 'import setuptools; print(setuptools.__version__)'): base is in the wheel $wheel time," \
    "in the archive $archive times; in the project's sources now: $(ls -d base)"
[ "$wheel" = 1 ] && [ "$archive" = 0 ] && [ -f base/__init__.py ] && ! grep -q "base/__init__" "$folder/warnings"
