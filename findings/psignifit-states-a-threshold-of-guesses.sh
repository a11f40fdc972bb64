#!/usr/bin/env bash
# One would guess: fitted to answers at chance, or to answers that become wrong as the stimulus grows, psignifit
# says that there is no threshold: by a warning, or by an interval that reaches the ends of what it searched.
# What is so: it returns a threshold with a finite interval of 95 %, for guesses without any warning. Its prior
# keeps the threshold within half a range of the stimuli on either side, and the estimate follows the prior:
# guesses, answers that are all right, and falling answers each get a threshold outside of the stimuli that were
# compared. A program that takes `threshold` takes these for people who feel something.
# Version: psignifit 4.3 (Python). Source: https://github.com/wichmann-lab/python-psignifit, psignifit/_priors.py
# (threshold_prior); Schuett, Harmeling, Macke and Wichmann, Vision Research 122, 2016.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/python" -m pip install --quiet --disable-pip-version-check \
    psignifit==4.3 numpy==2.2.6 scipy==1.15.3
"$folder/venv/bin/python" - <<'PY'
import sys
import warnings
from importlib.metadata import version

import numpy as np
import psignifit

print("psignifit", version("psignifit"), "numpy", np.__version__)
values, of, failed = [0.1, 0.2, 0.4, 0.8], 25, False
for name, right in (
    ("guesses", [9, 11, 15, 13]),
    ("all right", [25, 25, 25, 25]),
    ("falling", [25, 19, 17, 9]),
):
    data = np.array([[value, count, of] for value, count in zip(values, right)], dtype=float)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        result = psignifit.psignifit(data, experiment_type="2AFC", sigmoid="norm")
    threshold = float(result.parameter_estimate["threshold"])
    low, high = map(float, result.confidence_intervals["threshold"]["0.95"])
    outside = not values[0] <= threshold <= values[-1]
    about = [str(one.message).split("\n")[0] for one in told]
    print(f"{name}: {right} of {of} right at {values}: threshold {threshold:.3f}, 95 % {low:.3f} to {high:.3f}")
    print(f"  outside of what was compared: {outside}; warnings: {about or 'none'}")
    failed |= not (np.isfinite([threshold, low, high]).all() and outside)
    failed |= name == "guesses" and bool(told)
sys.exit(failed)
PY
