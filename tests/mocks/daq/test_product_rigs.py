"""What a product has terminals for runs on its generated rig; with --full all products, else a sample."""

import re
from dataclasses import replace
from pathlib import Path

import pytest

from haploop.nidaqmx_twin.products import PRODUCTS
from tests.mocks.daq import product_rigs

SAMPLE = ("USB-6211", "USB-6001", "NI 9234", "cDAQ-9174")


@pytest.fixture(scope="module")
def presses(tmp_path_factory: pytest.TempPathFactory) -> product_rigs.Pressed:
    return product_rigs.pressed(tmp_path_factory.mktemp("presses"))


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """All products with --full, else a sample."""
    if "name" in metafunc.fixturenames:
        metafunc.parametrize("name", PRODUCTS if metafunc.config.getoption("--full") else SAMPLE)


@pytest.mark.long
@pytest.mark.parametrize("simulate", ["twin", "wire"])
def test_what_a_product_can_do_runs_on_its_rig(name, simulate, tmp_path, presses, full):
    rig = product_rigs.of(name)
    steps = rig.steps if full else tuple(s for s in rig.steps if s in ("doctor", "record"))
    found = product_rigs.run(replace(rig, steps=steps), simulate, tmp_path, presses)
    assert found == dict.fromkeys(steps, "yes")
    assert "doctor" in found


def test_the_page_on_hardware_names_each_product():
    page = (Path(__file__).parents[3] / "docs" / "hardware.md").read_text(encoding="utf-8")
    part = " ".join(page.partition("### Other NI products")[2].partition("| delay")[0].split())
    assert [name for name in PRODUCTS if name not in re.split(r"[,.:] ?", part)] == []
