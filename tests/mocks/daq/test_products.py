"""The table of NI products: every row has a source, and one sentence says what a row lacks."""

import dataclasses
import tomllib
from pathlib import Path

import pytest

from haploop.base.errors import ConfigurationError
from haploop.instruments.daq.ni_settings import filter_delay
from haploop.nidaqmx_twin import products
from haploop.nidaqmx_twin.products import PRODUCTS


def test_a_product_has_a_source_and_what_its_terminals_need_and_the_readme_counts_them():
    known = {item.name for item in dataclasses.fields(next(iter(PRODUCTS.values())))}
    for name, product in PRODUCTS.items():
        assert product.source and set(product.estimates) <= known, name
        assert product.source != "estimate" or not product.estimates, f"{name}: all of it is an estimate"
        assert list(product.ai_ranges) == sorted(product.ai_ranges, reverse=True), name
    readme = Path(products.__file__).with_name("README.md").read_text(encoding="utf-8")
    assert f"{len(PRODUCTS)} products" in readme


@pytest.mark.parametrize("rate_hz", [1000.0, 51_200.0])
def test_card_and_driver_have_a_filters_delay_from_the_same_data_sheet(rate_hz):
    """Each has a table of its own: a delay that the driver takes off in error shows in what is measured."""
    delays = {name: product.filter_delay(rate_hz) for name, product in PRODUCTS.items()}
    assert delays == pytest.approx({name: filter_delay(name, rate_hz) for name in PRODUCTS}, abs=1e-12)
    assert sum(delay > 0 for delay in delays.values()) == 13


def test_a_product_like_another_takes_its_figures_and_not_its_source():
    usb, pcie = PRODUCTS["USB-6343"], PRODUCTS["PCIe-6343"]
    assert dataclasses.replace(usb, name=pcie.name) == pcie
    rows = '[A]\nfamily = "C Series"\nnumber = 7\nsource = "x"\n[B]\nlike = "A"\nsource = "y"\n'
    own = products._read(tomllib.loads(rows), {})
    assert (own["B"].source, own["B"].number, own["B"].family) == ("y", 0, "C Series")


@pytest.mark.parametrize(
    ("row", "sentence"),
    [
        (
            'ai_differential = 4\nfamily = "C Series"',
            "lacks: source, ai_ranges, ai_rate_hz, ai_rate_single_hz",
        ),
        ('family = "X Series"\nsource = "x"\nao_channels = 2', "lacks: ao_range, ao_rate_hz"),
        ('family = "X Series"\nsource = "x"\nranges = [10.0]', "has unknown fields: ranges"),
        ('family = "Z Series"\nsource = "x"', "is of the family 'Z Series'; there are E Series, M Series"),
        ('like = "B"\nsource = "x"', "is like 'B', which is not in the table"),
    ],
)
def test_one_sentence_says_what_a_row_lacks(row, sentence):
    with pytest.raises(ConfigurationError, match=f"The product 'A' {sentence}"):
        products._read(tomllib.loads(f"[A]\n{row}\n"), {})
