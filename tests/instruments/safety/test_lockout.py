"""The lockout of each piece of hardware: found on any of a rig's pieces, kept, and cleared on all."""

from dataclasses import FrozenInstanceError
from pathlib import Path

import pytest

from haploop.base.errors import ConfigurationError
from haploop.instruments.safety import machine
from haploop.instruments.safety.lockout import Lockout, clear_lockout, lockout_of, set_lockout

PIECES = ("card Dev1", "card Dev2", "relay COM3")
FIRST, SECOND = (Lockout("now", why, "me", "trips/1.npz") for why in ("A force.", "A velocity."))


def path_of(folder: Path, piece: str) -> Path:
    return folder / machine.file_for(piece, "lockout")


@pytest.mark.parametrize("piece", PIECES)
def test_a_lockout_of_one_piece_locks_out_every_rig_with_it_and_no_other(tmp_path, piece):
    folder = tmp_path / "state" / "rigs"
    assert lockout_of(folder, PIECES) is None
    set_lockout(folder, {piece}, FIRST)
    assert lockout_of(folder, PIECES) == FIRST
    assert lockout_of(folder, set(PIECES) - {piece}) is None
    set_lockout(folder, PIECES, SECOND)
    assert [lockout_of(folder, {one}) == FIRST for one in PIECES] == [one == piece for one in PIECES]
    clear_lockout(folder, PIECES)
    assert lockout_of(folder, PIECES) is None
    set_lockout(folder, {piece}, SECOND)
    assert lockout_of(folder, PIECES) == SECOND


@pytest.mark.parametrize("piece", PIECES)
def test_clearing_reaches_every_piece_and_makes_no_file(tmp_path, piece):
    set_lockout(tmp_path, {piece}, FIRST)
    clear_lockout(tmp_path, PIECES)
    assert lockout_of(tmp_path, PIECES) is None
    assert list(tmp_path.iterdir()) == [path_of(tmp_path, piece)]


def test_an_unreadable_lockout_locks_out_and_an_unclearable_one_is_said(tmp_path):
    path_of(tmp_path, PIECES[1]).write_bytes(b"{}")
    found = lockout_of(tmp_path, PIECES)
    assert found is not None and "is damaged or was changed by hand" in found.why
    assert "haploop reset" in found.sentence
    path_of(tmp_path, PIECES[1]).unlink()
    path_of(tmp_path, PIECES[2]).mkdir()
    found = lockout_of(tmp_path, PIECES)
    assert found is not None and "cannot be read" in found.why and found.samples == ""
    with pytest.raises(ConfigurationError, match=r"cannot be cleared .*: remove what is there"):
        clear_lockout(tmp_path, PIECES)


def test_what_a_lockout_says_is_not_changed():
    with pytest.raises(FrozenInstanceError):
        FIRST.why = "nothing"
    assert "(A force)." in FIRST.sentence
