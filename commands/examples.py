"""One example of each command, and a short course of each group, shown at the end of its help."""

from __future__ import annotations

import click

EXAMPLES = {
    "analyse confusion": "haploop analyse confusion answers.csv --plot confusion.pdf",
    "analyse power": "haploop analyse power plan.toml --runs 1000",
    "analyse ratings": "haploop analyse ratings ratings.csv --plot ratings.pdf",
    "analyse thresholds": "haploop analyse thresholds staircase.csv",
    "button check": "haploop button check latch.h5 --rig lab.toml",
    "button make": "haploop button make recordings/P01-latch.h5 -c calibration.h5 -o latch.h5",
    "button plan": "haploop button plan press.h5 -c calibration.h5 --plot plan.png",
    "button under": "haploop button under push.h5 -c P01-finger.h5 -o push-P01.h5 --rig lab.toml",
    "calibrate": "haploop calibrate --patch A --point button --out calibration.h5",
    "calibrate-finger": "haploop calibrate-finger calibration.h5 -p P01 -o P01-finger.h5",
    "calibrations activate": 'haploop calibrations activate 2 --rig lab.toml --reason "back in room 3"',
    "calibrations adopt": 'haploop calibrations adopt latch.h5 --rig lab.toml --reason "new plate"',
    "calibrations diff": "haploop calibrations diff 1 2 --rig lab.toml",
    "calibrations list": "haploop calibrations list --rig lab.toml",
    "calibrations plot": "haploop calibrations plot trend.pdf --rig lab.toml",
    "calibrations show": "haploop calibrations show 2 --rig lab.toml",
    "check": "haploop check recordings/P01-latch.h5 -c calibration.h5 --out checked",
    "demo": "haploop demo --seed 7 --out demo",
    "doctor": "haploop doctor --rig lab.toml --simulate wire",
    "experiment export": "haploop experiment export matching answers.csv",
    "experiment predict": "haploop experiment predict latch.h5 toggle.h5 push.h5 -o model.toml",
    "experiment new": "haploop experiment new matching --from matching",
    "experiment run": "haploop experiment run matching --participant P01",
    "experiment simulate": "haploop experiment simulate matching --participants 12",
    "experiment status": "haploop experiment status matching",
    "experiment withdraw": "haploop experiment withdraw matching P01",
    "export": "haploop export press.h5 --to wav48 --out press.wav",
    "figures": "haploop figures pilot --paper --columns 1 --out figures",
    "import": "haploop import run7.csv --mapping lab.toml --out recordings",
    "list": 'haploop list kind=recording button=latch "date>=2026-11" --in data',
    "live": "haploop live --rig lab.toml --wait 60",
    "log": "haploop log --rig lab.toml",
    "map": "haploop map --points 0,5,12-20 --patches A,C --out map",
    "recalibrate": "haploop recalibrate --rig lab.toml",
    "record": "haploop record latch --participant P01 --presses 5",
    "recover": "haploop recover recordings/P01-latch.h5",
    "report": "haploop report pilot calibration.h5 latch.h5 --out report.html",
    "represent": "haploop represent P01-latch.h5 P02-latch.h5 --out press.h5",
    "reset": 'haploop reset --rig lab.toml --reason "gain set back to 50"',
    "new": "haploop new my-study --buttons latch,push --participants 12 --rig lab.toml",
    "rig new": "haploop rig new lab.toml --like usb-6211",
    "rig check": "haploop rig check lab.toml",
    "schema": "haploop schema > rig.json_schema.json",
    "serve": "haploop serve --rig lab.toml --data study-2026",
    "show": "haploop show recordings/P01-latch.h5 --plot latch.pdf",
    "study new": "haploop study new pilot",
    "study process": "haploop study process --study pilot --out processed",
    "study reject": 'haploop study reject P01 latch 7 --study pilot --reason "the phone rang"',
    "study repeat": "haploop study repeat P01 latch --study pilot",
    "study represent": "haploop study represent latch --study pilot --out latch.h5",
    "study run": "haploop study run --study pilot --participant P01",
    "study status": "haploop study status --study pilot",
    "tape mask": "haploop tape mask day.tape mail.tape --hide Smith",
    "tape show": "haploop tape show day.tape",
    "twin all": "haploop twin all --rig haptable --press latch",
    "twin ni": "haploop twin ni --rig haptable",
    "verify": "haploop verify recordings/*.h5 calibration.h5",
}


COURSES = {
    "": (
        "haploop demo",
        "haploop record latch --participant P01",
        "haploop calibrate",
        "haploop button make recordings/P01-latch.h5 -c calibration.h5 -o latch.h5",
        "haploop button check latch.h5",
    ),
    "analyse": (
        "haploop experiment export matching answers.csv",
        "haploop analyse confusion answers.csv --plot confusion.pdf",
    ),
    "button": (
        "haploop button make recordings/P01-latch.h5 -c calibration.h5 -o latch.h5",
        "haploop button check latch.h5",
    ),
    "calibrations": (
        'haploop calibrations adopt latch.h5 --rig lab.toml --reason "new plate"',
        "haploop recalibrate --rig lab.toml",
        "haploop calibrations list --rig lab.toml",
    ),
    "experiment": (
        "haploop experiment new matching",
        "haploop experiment run matching --participant P01",
        "haploop experiment export matching answers.csv",
    ),
    "rig": ("haploop rig new lab.toml --like usb-6211", "haploop rig check lab.toml"),
    "study": (
        "haploop study new pilot",
        "haploop study run --study pilot --participant P01",
        "haploop study status --study pilot",
        "haploop study process --study pilot --out processed",
    ),
    "tape": (
        "haploop doctor --rig lab.toml --tape day.tape",
        "haploop tape show day.tape",
        "haploop tape mask day.tape mail.tape",
        "haploop doctor --simulate tape:mail.tape",
    ),
    "twin": ("haploop twin all --rig haptable --press latch",),
}
"""Commands of a group in the order in which they are given; "" is `haploop` itself."""


def show_examples(group: click.Group, path: str = "") -> None:
    """Put the examples below the help of a group and of its commands."""
    group.epilog = _block("Examples" if len(COURSES[path]) > 1 else "Example", *COURSES[path])
    for name, command in group.commands.items():
        whole = f"{path} {name}".strip()
        if isinstance(command, click.Group):
            show_examples(command, whole)
            continue
        for option in command.params:
            if isinstance(option, click.Option) and isinstance(option.type, click.IntRange):
                option.metavar = option.metavar or "N"
        if whole in EXAMPLES:
            command.epilog = _block("Example", EXAMPLES[whole])


def _block(title: str, *lines: str) -> str:
    # \b keeps click from joining the lines.
    return "\n  ".join([f"\b\n{title}:", *lines])
