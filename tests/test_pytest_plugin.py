"""The pytest plugin that haploop ships, in runs of their own, as another project would see them."""

import os
import warnings

import pytest

from haploop.instruments import open_rig
from tests.elsewhere import in_use_elsewhere

pytest_plugins = ["pytester"]

TESTS = """
import pytest

def test_opens(rig):
    assert rig.daq.identity

def test_relay(rig):
    rig.relay.connect(["A"])

@pytest.mark.requires("daq", "force", "acceleration")
def test_has(rig):
    pass

@pytest.mark.requires("table")
def test_has_not(rig):
    assert rig.table

@pytest.mark.requires("simulation")
def test_asks_the_plant(rig):
    assert rig.simulation.truth.presses == ()

def test_another_plant(open_rig):
    assert open_rig("simulated", seed=7).file.simulation.seed == 7

def test_alone():
    pass
"""

TYPO = """
import pytest

@pytest.mark.requires("fource")
def test_typo(rig):
    pass
"""

STRANGER = """
import sys
import pytest

@pytest.fixture
def rigs():
    return "of another kind"

@pytest.fixture
def rig(rigs):
    return rigs

@pytest.mark.requires("numpy>=1")
def test_own(rig):
    assert rig == "of another kind"
    assert not {"instruments", "mocks", "acquisition"} & set(sys.modules)
"""

CARDS = """
def test_cards(nidaqmx_twin):
    assert type(nidaqmx_twin).__module__ == {0!r}
"""

ARGUMENTS = ("-rs", "--strict-markers", "-p", "no:cacheprovider")


@pytest.fixture(scope="module", autouse=True)
def imported() -> None:
    """Everything that a rig imports: pytester forgets what is imported during its run."""
    open_rig("simulated").close()


def run(pytester: pytest.Pytester, *args: str) -> pytest.RunResult:
    with warnings.catch_warnings():
        # That haploop has been imported already.
        warnings.simplefilter("ignore", pytest.PytestAssertRewriteWarning)
        return pytester.runpytest_inprocess(*ARGUMENTS, *args)


def test_a_simulated_rig_is_opened_and_what_it_lacks_is_skipped(pytester):
    pytester.makepyfile(TESTS)
    pytester.makefile(".toml", lab='base = "minimal"\nname = "lab"')
    pytester.makeini("[pytest]\nrig_file = lab.toml")
    result = run(pytester)
    result.assert_outcomes(passed=5, skipped=1, failed=1)
    result.stdout.fnmatch_lines(["*has no [[]relay]; this step needs one*", "*the rig 'lab' has no table*"])
    run(pytester, "-m", "rig", "--collect-only", "-q").stdout.fnmatch_lines(["*6/7 tests collected*"])


def test_hardware_that_is_not_there_is_skipped_with_the_reason(pytester):
    pytester.makepyfile(TESTS)
    pytester.makefile(".toml", lab='base = "haptable"\nname = "lab"')
    result = run(pytester, "--rig", "lab.toml")
    result.assert_outcomes(passed=1, skipped=6)
    reasons = str(result.stdout)
    assert "needs simulation settings, which hardware does not have" in reasons
    assert "the rig 'lab' has no simulation" in reasons
    assert "the rig lab.toml could not be opened: " in reasons


def test_a_mistake_in_a_rig_file_ends_the_run_and_one_in_what_is_required_is_an_error(pytester):
    pytester.makepyfile(TESTS)
    pytester.makefile(".toml", lab='base = "haptable"\nnmae = "lab"')
    result = run(pytester, "--rig", "lab.toml")
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    result.stderr.fnmatch_lines(["ERROR: *lab.toml*unknown key 'nmae'; did you mean 'name'?*"])
    pytester.makepyfile(TYPO)
    result = run(pytester)
    result.assert_outcomes(errors=1)
    result.stdout.fnmatch_lines(["*requires() does not know 'fource'; it accepts *force*table*simulation*"])


@pytest.mark.long
def test_a_project_of_other_rigs_is_left_alone(pytester):
    pytester.makepyfile(STRANGER)
    pytester.runpytest_subprocess(*ARGUMENTS).assert_outcomes(passed=1)
    run(pytester, "-m", "rig").assert_outcomes(deselected=1)


def test_two_runs_never_share_hardware(pytester):
    pytester.makepyfile(TESTS)
    lab = pytester.makefile(".toml", lab='base = "haptable"\nname = "lab"')
    with in_use_elsewhere(lab):
        result = run(pytester, "--rig", "lab.toml")
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    result.stderr.fnmatch_lines([f"ERROR: The rig 'lab' is in use (*) by process {os.getpid()} (*: wait*"])


def test_a_rig_that_is_not_there_is_one_sentence_also_with_workers(pytester):
    pytester.makepyfile(TESTS)
    result = pytester.runpytest_subprocess(*ARGUMENTS, "-n", "2", "--rig", "nonsuch.toml")
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    result.stderr.fnmatch_lines(["ERROR: *There is no rig file *nonsuch.toml: use an existing file*"])
    assert "INTERNALERROR" not in str(result.stdout)


@pytest.mark.long
def test_hardware_runs_on_one_worker(pytester):
    pytester.makepyfile(TESTS)
    lab = pytester.makefile(".toml", lab='base = "haptable"\nname = "lab"')
    result = pytester.runpytest_subprocess(*ARGUMENTS, "-n", "2", "--rig", "lab.toml")
    result.assert_outcomes(passed=1, skipped=6)
    result.stdout.fnmatch_lines(["The rig 'lab' is hardware*all tests ran on one worker, and not on 2."])
    with in_use_elsewhere(lab):
        busy = pytester.runpytest_subprocess(*ARGUMENTS, "-n", "2", "--rig", "lab.toml")
    assert busy.ret == pytest.ExitCode.USAGE_ERROR
    busy.stderr.fnmatch_lines(["ERROR: The rig 'lab' is in use (*"])


@pytest.mark.long
@pytest.mark.parametrize("first", ["a_twin", "z_twin"])
def test_the_package_of_the_cards_by_itself_brings_their_fixture(first, pytester, monkeypatch):
    # What `pip install ./nidaqmx_twin` adds: a plugin of this name. In both orders of the two packages.
    source = "class NiTwin: pass\n\n@pytest.fixture\ndef nidaqmx_twin():\n    return NiTwin()\n"
    pytester.makepyfile(**{first: f"import pytest\n\n{source}"})
    info = pytester.mkdir(f"{first}-1.0.dist-info")
    (info / "METADATA").write_text(f"Name: {first}\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[pytest11]\nnidaqmx_twin = {first}\n")
    monkeypatch.setenv("PYTHONPATH", str(pytester.path), prepend=os.pathsep)
    pytester.makepyfile(test_it=CARDS.format(first))
    pytester.runpytest_subprocess("-p", "no:cacheprovider").assert_outcomes(passed=1)


@pytest.mark.long
def test_haploop_brings_the_fixture_of_the_cards(pytester):
    pytester.makepyfile(CARDS.format("haploop.nidaqmx_twin.twin"))
    pytester.runpytest_subprocess(*ARGUMENTS).assert_outcomes(passed=1)
    marks = pytester.runpytest_subprocess("--markers").outlines
    assert len([line for line in marks if line.startswith("@pytest.mark.nidaqmx(")]) == 1
