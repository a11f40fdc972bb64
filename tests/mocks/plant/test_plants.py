"""Another plant comes from a package or as an object; a broken one stops nobody who does not ask for it."""

import re
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.signal import lfilter

from haploop.base.errors import ConfigurationError, InstrumentError
from haploop.commands.cli import cli
from haploop.instruments import load_rig_file, open_rig
from haploop.instruments.config import RigFile
from haploop.instruments.rig.json_schema import rig_schema
from haploop.mocks.plant import Modal, ModalSurface, Modes, PlantSource, Surface, random_modal
from tests.raising import raises

GUIDE = (Path(__file__).parents[3] / "docs" / "how-to" / "adding-a-plant.md").read_text(encoding="utf-8")
BLOCKS = dict(re.findall(r"^```\w+\n# (\S+)\n(.*?)^```$", GUIDE, re.MULTILINE | re.DOTALL))
STEP = 1 / 50_000
Install = Callable[..., None]


@pytest.fixture
def install(install_package: Install) -> Install:
    """Install a package of one module that gives one plant."""
    return partial(install_package, "plants", package="acme-plants")


@pytest.fixture
def string(install: Install) -> None:
    """The package that docs/how-to/adding-a-plant.md shows."""
    assert 'acme-string = "acme_string:String"' in BLOCKS["pyproject.toml"]
    install("acme-string", "acme_string", BLOCKS["acme_string.py"], "String")


@pytest.mark.usefixtures("string")
def test_the_guides_plant_is_what_the_laser_sees(tmp_path):
    path = tmp_path / "string.toml"
    path.write_text(BLOCKS["string.toml"], encoding="utf-8")
    with open_rig(path) as rig:
        assert rig.simulation.truth.surface.modes(0.0).natural_hz[0] == 120
        t = np.arange(50_000) * STEP
        capture = rig.excite(20 * np.sin(2 * np.pi * 300 * t**2) * np.hanning(50_000), ["A"], ["laser"])
        spectrum = np.abs(np.fft.rfft(capture.volts[0]))
        f = np.fft.rfftfreq(len(capture.volts[0]), STEP)
        assert abs(f[spectrum.argmax()] / 120 - round(f[spectrum.argmax()] / 120)) < 0.05
    string = rig_schema()["$defs"]["SimulationSettings"]["allOf"]
    assert ["lowest_hz" in rule["then"]["properties"] for rule in string].count(True) == 1


@pytest.mark.usefixtures("string")
@pytest.mark.parametrize(
    ("table", "says"),
    [
        ('plant = "acme-string"\nlowst_hz = 1', r"line 4: unknown key 'simulation.lowst_hz'; did you mean"),
        ('plant = "acme-string"\nsead = 1', "did you mean 'seed'"),
        ('plant = "acme-string"\nmode_drift = 0.1', "unknown key 'simulation.mode_drift'"),
        ('plant = "acme-string"\ndamping = "x"', "simulation.damping must be a number"),
        ('plant = "acme-strong"', "no plant 'acme-strong'; installed are acme-string, .*modal, table"),
    ],
)
def test_its_settings_are_checked_like_any_others(table, says, tmp_path):
    path = tmp_path / "rig.toml"
    path.write_text(f'base = "simulated"\n[simulation]\n{table}\n', encoding="utf-8")
    raises(ConfigurationError, says, open_rig, path)


@pytest.mark.usefixtures("string")
def test_another_plant_takes_no_settings_of_the_one_below(tmp_path):
    (tmp_path / "drifted.toml").write_text('base = "simulated"\n[simulation]\nmode_drift = 0.1\nseed = 4\n')
    (tmp_path / "rig.toml").write_text('base = "drifted.toml"\n[simulation]\nplant = "acme-string"\n')
    assert load_rig_file(tmp_path / "rig.toml").simulation.settings == {}
    with open_rig(tmp_path / "drifted.toml", simulation={"plant": "acme-string"}) as rig:
        assert rig.file.simulation.settings == {"lowest_hz": 90.0, "damping": 0.01}
        assert rig.file.simulation.seed == 4


HEAD = "from haploop.mocks.plant import PlantSettings\nclass Bad(PlantSettings):\n"
NO_MODEL = "The plant 'acme-bad' of the package acme-plants must be a pydantic model, with a method make"
BROKEN = [
    ("def (", r"acme-plants cannot be loaded \(SyntaxError"),
    ("class Bad: ...", NO_MODEL),
    ("from pydantic import BaseModel\nclass Bad(BaseModel): ...", NO_MODEL),
    (
        "from pydantic import BaseModel\nclass Bad(BaseModel):\n  def make(self, file, rng): ...",
        "The plant 'acme-bad' of the package acme-plants is not a plant",
    ),
    (f"{HEAD}  def make(self, file, rng): return 3", "The plant 'acme-bad' made an object of int"),
    (f"{HEAD}  def make(self, file, rng): 1 / 0", r"The plant 'acme-bad' failed \(ZeroDivisionError"),
    (f"{HEAD}  pass", NO_MODEL),
]


@pytest.mark.parametrize(("source", "says"), BROKEN)
def test_a_broken_plant_is_one_sentence(install, source, says, tmp_path):
    install("acme-bad", "acme_bad", source, "Bad")
    path = tmp_path / "rig.toml"
    path.write_text('base = "simulated"\n[simulation]\nplant = "acme-bad"\n')
    raises((ConfigurationError, InstrumentError), says, open_rig, path)
    if source in ("def (", BROKEN[-2][0]):  # found when it is loaded, and when it is made
        done = CliRunner().invoke(cli, ["calibrate", "--rig", str(path)])
        assert done.exit_code in (2, 3) and "acme-" in done.output and "Traceback" not in done.output
        with open_rig("simulated"):
            pass
        settings = rig_schema()["$defs"]["SimulationSettings"]["properties"]
        assert settings["plant"]["enum"][-2:] == ["modal", "table"]


class Resonator(Surface):
    """One mode without `ModalSurface`: a difference equation at the outputs' steps, and lines between."""

    def __init__(self, patches: tuple[str, ...], hz: float, damping: float) -> None:
        self.patches = patches
        self._own = 2 * np.pi * hz * (-damping + 1j * np.sqrt(1 - damping**2))
        self._state, self._end = 0j, 0.0
        self._times, self._seen = [np.zeros(1)], [np.zeros(1)]

    def step(self, start: float, period: float, volts: Mapping[str, np.ndarray]) -> None:
        drive = np.asarray(volts["A"])
        if not np.isfinite(period):
            return
        decay = np.exp(self._own * period)
        self._state *= np.exp(self._own * max(start - self._end, 0.0))
        states, _ = lfilter([(decay - 1) / self._own], [1, -decay], drive, zi=[decay * self._state])
        self._state, self._end = states[-1], start + period * len(drive)
        self._times.append(start + period * np.arange(1, len(drive) + 1))
        self._seen.append((self._own / (1j * self._own.imag) * states).real)

    def velocity(self, place: tuple[float, float], times: np.ndarray) -> np.ndarray:
        return np.interp(times, np.concatenate(self._times), np.concatenate(self._seen), right=0.0)

    def response(
        self, patch: str, place: tuple[float, float], frequencies: np.ndarray, time: float
    ) -> np.ndarray:
        s = 2j * np.pi * frequencies
        return s / ((s - self._own) * (s - self._own.conjugate())) * (patch == "A")


class Alone(PlantSource):
    """A plant that is no pydantic model and has no modes."""

    def make(self, file: RigFile, rng: np.random.Generator) -> Surface:
        return Resonator(("A", "B", "C", "D"), 200.0, 0.02)


class AsModes(PlantSource):
    """The same as modes."""

    def make(self, file: RigFile, rng: np.random.Generator) -> Surface:
        coupling = {patch: np.array([float(patch == "A")]) for patch in "ABCD"}
        return ModalSurface(Modes(np.array([200.0]), np.array([0.02]), coupling, lambda _place: np.ones(1)))


def test_a_surface_without_modes_is_measured_like_one_with(open):
    """Up to the amplifier's pole, which the one has and the other has not."""
    t = np.arange(25_000) * STEP
    drive = 2 * np.sin(2 * np.pi * 400 * t**2) * np.hanning(25_000)
    seen = []
    for plant in (Alone(), AsModes()):
        rig = open(plant=plant, vibrometer_noise_scale=0, hysteresis=0)
        capture = rig.excite(drive, ["A"], ["laser"])
        seen.append(np.fft.rfft(rig.vibrometer.to_si(capture.volts[0])))
        assert rig.simulation.truth.resonance_hz == pytest.approx(200, abs=0.01)
        assert rig.file.simulation.plant.endswith(f"test_plants.{type(plant).__name__}")
    f = np.fft.rfftfreq(len(capture.volts[0]), STEP)
    inside = (f > 50) & (f < 600)
    own, exact = seen[0][inside] / (1 + 1j * f[inside] / 5000), seen[1][inside]
    assert np.linalg.norm(own - exact) < 0.01 * np.linalg.norm(exact)


class Failing(Resonator):
    def velocity(self, place: tuple[float, float], times: np.ndarray) -> np.ndarray:
        return np.full(len(times), np.nan) if self._state else np.zeros(len(times))


def test_a_plant_that_fails_while_it_runs_is_one_sentence(open):
    class Nan(PlantSource):
        def make(self, file: RigFile, rng: np.random.Generator) -> Surface:
            return Failing(("A", "B", "C", "D"), 200.0, 0.02)

    rig = open(plant=Nan())
    with pytest.raises(
        InstrumentError, match=r"The plant '.*Nan' failed \(ValueError: .*not finite.*ask its"
    ):
        rig.excite(np.hanning(2000) * np.sin(np.arange(2000) / 10), ["A"], ["laser"])


def test_what_a_surface_cannot_have_is_refused(open):
    class OnePatch(PlantSource):
        def make(self, file: RigFile, rng: np.random.Generator) -> Surface:
            return Resonator(("A",), 200.0, 0.02)

    with pytest.raises(ConfigurationError, match=r"has the patches A, and \[table\] .* also names B, C, D"):
        open(plant=OnePatch())
    with pytest.raises(ConfigurationError, match=r"'mode-drift' changes modes, and the surface of .*Alone"):
        open(plant=Alone(), faults=[{"kind": "mode-drift", "frequency": 0.01}])
    with pytest.raises(ConfigurationError, match="an object of Resonator: give an instance"):
        open(plant=Resonator(("A",), 200.0, 0.02))
    with pytest.raises(ConfigurationError, match=r"opened on its hardware, .*: simulate it"):
        open_rig("haptable", plant=Alone())


def test_a_plant_of_modes_is_told_and_opened_again(open):
    plant = random_modal(np.random.default_rng(5))
    rig = open(plant=plant)
    told = rig.file.simulation
    assert told.plant == "modal"
    again = open(plant="modal", **told.settings)
    f = np.arange(50.0, 600.0)
    one, two = (each.simulation.truth.velocity_response("A", "button", f) for each in (rig, again))
    np.testing.assert_array_equal(one, two)
    assert 0.9e-4 < np.abs(one).max() < 1.001e-4
    with pytest.raises(ConfigurationError, match="no shapes at the point 3: add it"):
        rig.simulation.truth.velocity_response("A", "3", f)
    with pytest.raises(ConfigurationError, match="damping has 1 numbers, and natural_hz has 2"):
        open(
            plant="modal", natural_hz=[1, 2], damping=[0.1], coupling={"A": [1, 1]}, shapes={"button": [1, 1]}
        )


def test_random_plants_are_of_every_kind():
    drawn = [random_modal(np.random.default_rng([20, k])) for k in range(60)]
    counts = [len(plant.natural_hz) for plant in drawn]
    assert min(counts) < 12 and max(counts) > 50
    damping = np.concatenate([plant.damping for plant in drawn])
    assert 0.002 <= damping.min() < 0.0025 and 0.04 < damping.max() <= 0.05
    assert all(isinstance(plant, Modal) and set(plant.coupling) == set("ABCD") for plant in drawn)
