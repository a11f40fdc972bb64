#!/usr/bin/env bash
# One would guess: `wf_start_time` of a channel, as npTDMS gives it in `properties`, is when the channel's first
# sample was taken; LabVIEW's waveforms and `time_track(absolute_time=True)` use it so.
# What is so: a TDMS file is appended segment by segment, each may write the property anew, and npTDMS keeps the
# newest. The data begin with the first segment, so that the whole time track is late by all earlier segments. The
# earlier values are in the file, and no public part of npTDMS gives them.
# Version: npTDMS 1.10.0. Source: https://nptdms.readthedocs.io/en/stable/apireference.html (TdmsChannel.properties,
# TdmsChannel.time_track).
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/python" -m pip install --quiet --no-compile --disable-pip-version-check npTDMS==1.10.0 numpy==2.2.6
cat > "$folder/segments.py" <<'PY'
import sys

import numpy as np
from nptdms import ChannelObject, TdmsFile, TdmsWriter

starts = np.array(["2026-05-01T10:00:00", "2026-05-01T10:00:10"], dtype="datetime64[us]")
path = sys.argv[1]
with TdmsWriter(path) as file:
    for start in starts:  # ten seconds each, one after the other
        about = {"wf_start_time": start, "wf_increment": 1.0, "wf_start_offset": 0.0}
        file.write_segment([ChannelObject("measured", "force", np.arange(10.0), about)])
channel = TdmsFile.read(path)["measured"]["force"]
first = channel.time_track(absolute_time=True, accuracy="us")[0]
print("samples:", len(channel[:]))
print("started:", starts[0])
print("npTDMS says that the first sample was taken:", first)
sys.exit(not (len(channel[:]) == 20 and first == starts[1] == channel.properties["wf_start_time"]))
PY
"$folder/venv/bin/python" --version
"$folder/venv/bin/python" -m pip list --disable-pip-version-check 2> /dev/null | grep -i "^nptdms"
"$folder/venv/bin/python" "$folder/segments.py" "$folder/one.tdms"
