"""What a command refuses: exit code 2 and one sentence, which names what was found and what to do."""

import shlex
from pathlib import Path
from typing import get_args

import pytest

from haploop.acquisition import AverageMethod

GAUGES = [f"gauge{number}" for number in range(6)]
SENSOR = f'base = "simulated"\n[sensors.force]\nchannels = {GAUGES}\nmatrix = '
FOLDER = {
    "taken": "in the way",
    "bytes": "\x80\x00\x81",
    "notes.txt": "my notes of today\n",
    "plant.toml": "[simulation]\nmode_drft = 0.1\n",
    "key.toml": 'base = "simulated"\nnmae = "x"\n',
    "driver.toml": 'base = "haptable"\n[relay]\ndriver = "no-such"\n',
    "other.toml": 'name = "mine"\n',
    "zero.toml": SENSOR + f"{[[0.0] * 6, [0.0] * 6, [5.2, *[0.0] * 5], *[[0.0] * 6] * 3]}\n",
    "equal.toml": SENSOR + f"{[[5.2, *[0.0] * 5]] * 6}\n",
    "hello.ini": "hello\n",
    "torn.ini": "[DAQmxDevice Dev1]\nProductType PCIe-6363\n",
    "empty.ini": "",
    "unknown.ini": "[DAQmxDevice Dev1]\nProductType=PCIe-1\n",
}
"""What lies in the folder in which each command is given, and is the same afterwards."""
MAKE = "button make {demo}/presses/push.h5 -c {demo}/calibration.h5 -o no.h5"
NEW = "--buttons a --participants 1 --rig simulated"
ROWS: list[tuple[str, str | tuple[str, ...]]] = [
    ("dance", ""),
    ("recrod", "haploop has no command 'recrod': did you mean record or recover? Try 'haploop --help'"),
    ("button mak", "haploop button has no command 'mak': did you mean make?"),
    ("demo --seed 'minus one'", ""),
    ("demo --seed -1", ""),
    ("demo --participants 0", ""),
    ("demo --simulate dream", ""),
    ("demo --rig no-such-rig", ""),
    ("demo --rig no/such/rig.toml", ""),
    ("demo --rig plant.toml", "mode_drift"),
    ("demo --out taken/folder", "taken"),
    ("record", ""),
    ("record latch", "haploop record needs --participant. Example: haploop record latch"),
    ("record latch --pressess 3", "record has no option --pressess: did you mean --presses?"),
    ("record latch -p", "-p needs a value after it. Try 'haploop record --help'"),
    ("record latch now -p P01", "haploop record takes fewer arguments: now is too many."),
    ("record latch --participant P01 --presses 0", ""),
    ("record latch -p P01 -n 0",
     ("--presses must be a whole number from 1 to 1000 (found 0). Try '", " record --help'")),
    ("record latch -p P01 -n 3x", ("must be a whole number ", " (found '3x').")),
    ("record push -p P01 -o out -n 1000000000", "Error: --presses must be a"),
    ("record push -p P01 -o out -n 1001", "Error: --presses must be a"),
    ("record latch -p P01 --wait x", ("must be a number from 0 to ", "(found 'x').")),
    ("record push -p P01 -o out --wait nan", "Error: --wait must be a"),
    ("record push -p P01 -o out --wait -1", "Error: --wait must be a"),
    ("record 'no such/button' --participant P01", ""),
    ("record latch --participant P01 --out taken/folder", "taken"),
    ("record latch -p P01 -n 1 -o out --rig zero.toml", "the row of matrix for x is zero"),
    ("record latch -p P01 -n 1 -o out --rig equal.toml", "the rows of matrix depend on each other"),
    ("show missing.h5", ""),
    ("show .", ""),
    ("show notes.txt", "is text, and no file of haploop"),
    ("recover missing.h5", ""),
    ("verify a.h5 --fast", "haploop verify has no option --fast. Try 'haploop verify --help'"),
    ("list kind=recordng", "no kind 'recordng': the kinds are recording, representative"),
    ("list kind!=recordng", "no kind 'recordng'"),
    ("export {demo}/recordings/P01-latch.h5 --to svg --out a.svg", "haploop figures FILE --out DIR"),
    ("calibrate --patch Z", ""),
    ("calibrate --point nowhere", ""),
    ("calibrate --point 84", ""),
    ("calibrate --out no/such/folder/c.h5", ""),
    ("calibrations activate nothing --reason why", ("none yet: make one with ", "adopt")),
    ("recalibrate --rig key.toml", "did you mean 'name'?"),
    ("check missing.h5 --calibration missing.h5", ""),
    ("check --calibration missing.h5", ""),
    ("check -c c.h5", "haploop check needs PRESS. Example: haploop check recordings/P01"),
    ("check a.h5 -c c.h5 --average median",
     "--average must be automatic, barycentre, registration or mean (found 'median')."),
    *((f"{command} latch --average median", get_args(AverageMethod))
      for command in ("represent", "check -c x.h5", "study represent", "button make -c x.h5")),
    ("button make --out", "--out needs a value after it. Try 'haploop button make --help'"),
    ("button check {demo}/calibration.h5", "is not a haploop button"),
    (f"{MAKE} --error loud", "'loud' is no number of %"),
    (f"{MAKE} --error nan", "'nan' is no number of %"),
    (f"{MAKE} --error 40%", "at most the 20"),
    (f"{MAKE} --level 90dB", "dB is the most"),
    ("doctor --mass nan", "must be a number"),
    ("map --level nan --out m", "must be a number"),
    ("map -o m --level 0", "--level must be a number above 0 (found 0.0)."),
    *((f"map --out map {wrong}", "")
      for wrong in ("--points x", "--points 84", "--patches Q", "--level 500", "--patches A,A",
                    "--points 0-9999999999")),
    ("new other --buttons 'a b' --participants 1 --rig simulated", "such as latch,push"),
    ("new other --buttons a,a --participants 1 --rig simulated", "different names"),
    ("new other --buttons a --participants 1 --rig nosuch", "There is no rig 'nosuch'"),
    ("new other --buttons a --participants 1", "Nobody is there to ask: say it with --rig"),
    ("new other --buttons x", "Nobody is there"),
    (f"new '' {NEW}", "an empty name is no file or folder"),
    (f"new {Path.cwd().anchor} {NEW}", f"{Path.cwd().anchor} has no name"),
    (f"new {'a' * 300} {NEW}", "aaaa... has 300 characters"),
    *((f"analyse {kind} {path} --json", "")
      for kind in ("confusion", "ratings", "power") for path in ("none", "bytes", ".")),
    ("serve --data taken", ("--data ", "taken is a file: name a folder")),
    ("twin ni --devices missing.ini", "missing.ini"),
    ("twin ni --devices x.ini --rig simulated", "--device"),
    ("twin ni --devices x.ini --device Dev1=PCIe-6363 -- true", "--device"),
    ("twin ni --device Dev1=PCIe-6363 --device Dev1=PCIe-6321 -- true",
     "Dev1 is in --device or in the bench twice"),
    ("twin ni --devices hello.ini -- true", "is not a text export of NI MAX"),
    ("twin ni --devices torn.ini -- true", "is not a text export of NI MAX"),
    ("twin ni --devices empty.ini -- true", "lists no device that can be simulated"),
    ("twin ni --devices unknown.ini -- true", "Dev1 (PCIe-1) is not known"),
    ("twin all --rig driver.toml", "'no-such'"),
    ("twin all --rig bench --port yocto=x", "--port wants KIND=N,KIND=N"),
    ("twin all --rig bench --port ni=1,ni=2", "--port wants KIND=N,KIND=N"),
    ("twin all --rig bench --port 4444", "--port wants KIND=N,KIND=N"),
    ("twin all --rig bench --port ofv=65536", "--port wants KIND=N,KIND=N"),
    ("twin all --rig bench --port nix=5", "'nix', and what is served is ni, yocto, ofv, scpi"),
    ("twin all --rig bench -- no-such-program", "no-such-program cannot be run"),
    ("twin all --rig bench --write other.toml", "other.toml exists and is another file"),
]  # fmt: skip


@pytest.mark.parametrize(("command", "says"), ROWS, ids=[command for command, _ in ROWS])
def test_a_wrong_request_is_one_sentence_and_exit_code_2(run, tmp_path, monkeypatch, request, command, says):
    monkeypatch.chdir(tmp_path)
    for name, text in FOLDER.items():
        Path(name).write_text(text, encoding="latin-1")
    if "{demo}" in command:
        command = command.replace("{demo}", str(request.getfixturevalue("demo").folder))
    result = run(*shlex.split(command), ends=2, says=says)
    assert result.stdout == ""
    errors = [line for line in result.stderr.splitlines() if not line.startswith("Everything here")]
    assert len(errors) == 1 and errors[0].startswith("Error: ") and errors[0].endswith((".", "?")), errors
    assert {path.name: path.read_text("latin-1") for path in tmp_path.iterdir()} == FOLDER
