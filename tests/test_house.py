"""Where things stand, and how they are reached. The rules:

1. The root is the package: a folder with an `__init__` is installed, but for the tests, and imports inside
   are relative.
2. A sub-package whose `__init__` hands on names is entered by that door: from outside it, product code says
   `from haploop.calibration.response import Response`, not `from haploop.calibration.response.response import
   Response`. A sub-package that hands on nothing (`haploop.commands`, those of `mocks`) is entered by its
   modules, and so are the small modules of a room, which stand in no sub-package (`base.arrays`).
   A driver may be imported by the module that its entry point names. A simulated instrument may import the
   modules of the product that it stands for: `mocks/daq` those of `instruments/daq`, because it speaks with
   the driver's codec and settings.
3. A name with a leading underscore stays in its package.
4. Inside a room, its own door is not used: it would import what stands above.
5. A file that is named in code or documents is there.
6. Nothing that haploop writes is committed by accident: recordings lie in `tests/data` only.
"""

import ast
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
CLIENTS = {"tests", "benchmarks", "examples", "docs", "build"}
ROOMS = {f"haploop.{init.parent.name}" for init in ROOT.glob("*/__init__.py")} - {
    f"haploop.{c}" for c in CLIENTS
}


def folder_of(package: str) -> Path:
    return ROOT.joinpath(*package.split(".")[1:])


def found_packages() -> set[str]:
    found = {"haploop"}
    for room in ROOMS:
        for init in folder_of(room).rglob("__init__.py"):
            if "build" in init.relative_to(ROOT).parts:
                continue  # what an installation of nidaqmx_twin by itself left behind
            found.add(".".join(["haploop", *init.parent.relative_to(ROOT).parts]))
    return found


PACKAGES = found_packages()
MODULES = {
    path: ".".join([package] if path.stem == "__init__" else [package, path.stem])
    for package in PACKAGES
    for path in folder_of(package).glob("*.py")
}
"""Every file of the product, and the name that it is imported by."""
IMPORTED = frozenset(MODULES.values())


ENTRY_POINTS = {
    module.partition(":")[0]
    for group in PROJECT["project"]["entry-points"].values()
    for module in group.values()
}


def handed_on(package: str) -> set[str]:
    """The names that a package's door hands on."""
    folder = folder_of(package)
    stub = folder / "__init__.pyi"
    door = (stub if stub.is_file() else folder / "__init__.py").read_text(encoding="utf-8")
    return {
        alias.asname or alias.name
        for node in ast.walk(ast.parse(door))
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
        if alias.asname or "__all__" in door
    }


DOORS = {package: handed_on(package) for package in PACKAGES}


def package_of(module: str) -> str:
    return module if module in PACKAGES else module.rpartition(".")[0]


def sub_package_of(module: str) -> str:
    """The sub-package of a room that a module stands in, however deep; empty for a room's own module."""
    candidate = ".".join(module.split(".")[:3])
    return candidate if candidate in PACKAGES - ROOMS and candidate.count(".") == 2 else ""


def inside(module: str, package: str) -> bool:
    return module == package or module.startswith(f"{package}.")


@cache
def import_statements(path: Path) -> list[ast.Import | ast.ImportFrom]:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return [node for node in ast.walk(tree) if isinstance(node, ast.Import | ast.ImportFrom)]


def imports(path: Path) -> Iterator[tuple[int, str, str]]:
    """Line, module, and name of every import of haploop's; the name is empty for a module."""
    package = package_of(MODULES[path]).split(".")
    for node in import_statements(path):
        if isinstance(node, ast.ImportFrom) and node.level:
            above = package[: len(package) + 1 - node.level]
            module = ".".join([*above, *([node.module] if node.module else [])])
            for alias in node.names:
                whole = f"{module}.{alias.name}"
                if whole in IMPORTED and alias.name not in DOORS[package_of(module)]:
                    yield node.lineno, whole, ""
                else:
                    yield node.lineno, module, alias.name


def role_of(module: str) -> str:
    """The folder of a sub-package in its room: `daq` of `haploop.nidaqmx_twin.server`."""
    parts = module.split(".")
    return parts[2] if len(parts) > 2 else ""


def stands_for(importer: str, module: str) -> bool:
    """A simulated instrument and the product that it stands for."""
    return (
        inside(importer, "haploop.mocks")
        and inside(module, "haploop.instruments")
        and role_of(importer) == role_of(module)
    )


@cache
def each_import() -> list[tuple[str, str, str, str]]:
    """Place, importer, module, and name of every import in the product."""
    return [
        (f"{path.relative_to(ROOT)}:{line}", MODULES[path], module, name)
        for path in sorted(MODULES)
        for line, module, name in imports(path)
    ]


def test_every_package_is_installed():
    """`setup.py` finds packages; what it would install is read from the distribution's own list."""
    code = (
        "import setuptools, runpy; said = {};"
        "setuptools.setup = lambda **words: said.update(words);"
        "runpy.run_path('setup.py'); print(*said['packages'])"
    )
    ran = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert sorted(ran.stdout.split()) == sorted(PACKAGES)


def test_imports_within_the_package_are_relative():
    """A tool that derives a module's name from its path resolves them, whatever the checkout is called."""
    wrong = [
        f"{path.relative_to(ROOT)}:{node.lineno}"
        for path in sorted(MODULES)
        for node in import_statements(path)
        if (isinstance(node, ast.Import) and any(inside(alias.name, "haploop") for alias in node.names))
        or (isinstance(node, ast.ImportFrom) and not node.level and inside(node.module or "", "haploop"))
    ]
    assert not wrong, "\n".join(wrong)


@pytest.mark.long
@pytest.mark.parametrize("where", ["beside", "in", "above"])
def test_a_script_finds_the_package_wherever_it_starts(where, tmp_path):
    """Above a clone that is called haploop, its folder is the package, and not an empty namespace."""
    if where == "above":
        try:
            (tmp_path / "haploop").symlink_to(ROOT, target_is_directory=True)
        except OSError:
            pytest.skip("this user may make no link")
    folder = ROOT if where == "in" else tmp_path
    script = tmp_path / "script.py"
    script.write_text("import haploop\nprint(haploop.open_rig.__module__)\n", encoding="utf-8")
    for started in ([str(script)], ["-c", script.read_text(encoding="utf-8")]):
        command = [sys.executable, *started]
        ran = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        assert ran.stdout == "haploop.instruments.rig.opening\n", ran.stderr


def test_a_sub_package_is_entered_by_its_door():
    wrong = [
        f"{place}: {module}"
        for place, importer, module, _ in each_import()
        if (package := sub_package_of(module)) not in ("", module)
        and DOORS[package]
        and not inside(importer, package)
        and not DOORS.get(module)  # a package in it, with a door of its own
        and module not in ENTRY_POINTS
        and not stands_for(importer, module)
    ]
    assert not wrong, "\n".join(["Import these names from the door of their package:", *wrong])


def test_private_names_stay_in_their_package():
    wrong = [
        f"{place}: {module} {name}"
        for place, importer, module, name in each_import()
        if any(part.startswith("_") and not part.startswith("__") for part in (*module.split("."), name))
        and package_of(importer) != package_of(module)
    ]
    assert not wrong, "\n".join(wrong)


def test_a_room_does_not_use_its_own_door():
    wrong = [
        f"{place}: {module}"
        for place, importer, module, name in each_import()
        if name and module in ROOMS and inside(importer, module) and importer != module
    ]
    assert not wrong, "\n".join(wrong)


NAMED = re.compile(r"(?<![\w/.*~<{:-])(?:\.{1,2}/)*[\w-]+(?:/[\w.-]+)*\.(?:md|py)\b")
"""A document, or a Python file; neither is part of an address or of a pattern."""
GUIDE = ROOT / "examples" / "haploop-acme-relay"
DOCUMENTS = (ROOT / "docs", *(ROOT / "docs" / part for part in ("how-to", "reference", "explanation")))


def tracked() -> list[Path]:
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True)
    return [ROOT / name for name in listed.stdout.decode().split("\0") if name and (ROOT / name).is_file()]


@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="what is tracked is known in a checkout only")
def test_a_file_that_is_named_is_there():
    """Of Python files only those with their folder: a script beside a reader's rig file is not ours."""
    files = set(tracked())
    ours = {path.relative_to(ROOT).parts[0] for path in files}
    wrong = []
    for path in sorted(files):
        if path.suffix not in {".py", ".pyi", ".md", ".toml", ".yml", ".cff"}:
            continue
        folders = (ROOT, *DOCUMENTS, path.parent, GUIDE)
        for name in NAMED.findall(path.read_text(encoding="utf-8")):
            first, _, rest = name.partition("/")
            if (name.endswith(".md") or (rest and first in {*ours, "..", "."})) and not any(
                (folder / name).resolve() in files for folder in folders
            ):
                wrong.append(f"{path.relative_to(ROOT)}: {name}")
    assert not wrong, "\n".join(["These files are named and are not there:", *wrong])


@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="what is tracked is known in a checkout only")
def test_no_data_file_is_committed_by_accident():
    stray = [
        str(path.relative_to(ROOT))
        for path in tracked()
        if path.suffix in {".h5", ".jsonl"} and not path.is_relative_to(ROOT / "tests" / "data")
    ]
    assert not stray, stray
