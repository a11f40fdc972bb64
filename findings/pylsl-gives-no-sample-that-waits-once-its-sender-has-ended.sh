#!/usr/bin/env bash
# One would guess: samples that an inlet has received can be pulled after their sender has ended, because
# `samples_available` counts them and `pull_chunk` with a timeout of 0 gives what is there.
# What is so: with recover=False `pull_chunk` raises LostError and gives none of them; with recover=True (the
# default) it does not return while the sender is away, though its timeout is 0. A recorder that looks twice a
# second loses up to half a second of what had arrived, or hangs until the sender is back.
# Version: pylsl 1.18.6. Source: https://github.com/labstreaminglayer/pylsl (pull_chunk: "if passed as 0.0, then
# only samples available for immediate pickup will be returned").
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/python" -m pip install --quiet --disable-pip-version-check pylsl==1.18.6 numpy==2.2.6
cat > "$folder/lsl_api.cfg" <<'CFG'
[ports]
IPv6 = disable
[multicast]
ResolveScope = machine
ListenAddress = 127.0.0.1
[lab]
KnownPeers = {127.0.0.1}
SessionID = finding
[log]
level = -3
CFG
cat > "$folder/sender.py" <<'PY'
import time
import pylsl

outlet = pylsl.StreamOutlet(pylsl.StreamInfo("amp", "EEG", 1, 100.0, "float32", "amp-1"))
outlet.wait_for_consumers(20)
for number in range(200):
    outlet.push_sample([number])
    time.sleep(0.01)
PY
cat > "$folder/receiver.py" <<'PY'
import subprocess
import sys
import time
import pylsl

sender = subprocess.Popen([sys.executable, sys.argv[1]])
inlet = pylsl.StreamInlet(pylsl.resolve_byprop("name", "amp", 1, 20)[0], recover=sys.argv[2] == "recover")
inlet.open_stream(5)
sender.wait()
time.sleep(1)
print(inlet.samples_available(), "samples are available", flush=True)
try:
    values, _ = inlet.pull_chunk(0.0, 1000)
    print("pulled", len(values))
except Exception as error:
    print(type(error).__name__)
PY
export LSLAPICFG="$folder/lsl_api.cfg"
run() { timeout 30 "$folder/venv/bin/python" "$folder/receiver.py" "$folder/sender.py" "$1" || echo "did not return within 30 s"; }
lost=$(run no) && echo "recover=False: $lost"
hung=$(run recover) && echo "recover=True: $hung"
[[ $lost == *"samples are available"*LostError* && $hung == *"samples are available"*"did not return"* ]]
