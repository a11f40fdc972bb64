"""Areas of squares of even brightness: the pixel counts are known by hand.

The image is averaged over 3 x 3 pixels, so that a square's edge falls to 2/3 and 1/3 of its brightness, and
its corners to 4/9 and 1/9.
"""

from dataclasses import FrozenInstanceError
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import scipy

from haploop.base.errors import DataError
from haploop.experiments.contact.area import (
    Background,
    Contact,
    ContactMeter,
    calibrate_meter,
    drop_old_frames,
    learn_background,
)
from haploop.instruments import Frame
from tests.raising import raises

SHAPE = (120, 160)


def taken(pixels: Any) -> Frame:
    return Frame(pixels, 7, 0.5)


def frame(*squares: tuple[int, int, int, float], light: float = 0.0) -> Frame:
    """Squares of (row, column, side, brightness above the background)."""
    pixels = np.full(SHAPE, 10.0 + light)
    for row, column, side, level in squares:
        pixels[row : row + side, column : column + side] += level
    return taken(pixels)


def seen(*squares: tuple[int, int, int, float], noise: float = 0.3, light: float = 0.0) -> Contact:
    meter = ContactMeter(Background(np.full(SHAPE, 10.0), noise), 2e-9)
    return meter.measure(frame(*squares, light=light))


def test_the_area_is_what_lies_above_half_of_the_brightness():
    found = seen((40, 50, 20, 100.0))
    assert found == Contact(7, 0.5, 396 * 2e-9, 396, 0, 0.0, "")
    # It depends neither on the brightness nor on the light around it.
    assert seen((40, 50, 20, 30.0)).pixels == seen((40, 50, 20, 100.0), light=9.0).pixels == 396
    assert seen() == Contact(7, 0.5, 0.0, 0, 0, 0.0, "")


@pytest.mark.parametrize(
    ("noise", "level", "there", "measured"),
    [
        *((0.3, 3.9, False, True), (0.3, 4.1, True, False), (0.3, 11.9, True, False)),
        *((0.3, 12.1, True, True), (6.0, 12.1, True, True), (9.0, 17.9, False, True),
            (9.0, 18.1, True, True)),
    ],
)  # fmt: skip
def test_a_finger_is_twelve_grey_levels_bright_or_six_times_the_smoothed_noise(noise, level, there, measured):
    """What is darker is seen, and said to be too dim."""
    found = seen((40, 50, 20, level), noise=noise)
    assert bool(found.pixels) is there
    assert (found.problem == "") is measured
    assert measured or f"{level:.0f} grey levels bright, and 12 are needed" in found.problem


def test_a_finger_is_sixty_pixels_or_more():
    # Above 12 of 100 grey levels lie the 8 x 8 pixels around a square of 6 x 6, without their corners.
    assert seen((40, 50, 6, 100.0)).pixels == 6 * 6 - 4
    assert seen((40, 50, 5, 100.0)).pixels == 0


def test_the_largest_is_the_finger_and_the_others_are_told():
    found = seen((40, 50, 20, 50.0), (80, 100, 12, 100.0), (20, 100, 4, 100.0))
    assert (found.pixels, found.others) == (396, 1) and "more than one finger" in found.problem
    assert seen((40, 50, 20, 240.0)).problem == ""
    assert "saturated" in seen((40, 50, 20, 241.0)).problem


@pytest.mark.parametrize(
    ("light", "noise", "changed"),
    [(9.9, 0.3, False), (-9.9, 0.3, False), (10.1, 0.3, True), (-10.1, 0.3, True), (17.9, 3.0, False),
     (18.1, 3.0, True)],
)  # fmt: skip
def test_a_change_of_the_light_is_told(light, noise, changed):
    for squares in ((), ((40, 50, 20, 100.0),)):
        found = seen(*squares, noise=noise, light=light)
        assert ("light changed" in found.problem) is changed
        assert found.light == pytest.approx(light)


def test_a_target_tells_the_area_of_a_pixel_and_is_sharp():
    background = Background(np.full(SHAPE, 10.0), 0.3)
    target = frame((40, 50, 20, 100.0))
    assert calibrate_meter([target] * 3, background, 396e-9).square_metres == pytest.approx(1e-9)
    for frames, said in (([], "no frame of the target"), ([frame()], "0 bright spots"),
        ([frame((40, 50, 20, 100.0), (80, 100, 20, 100.0))], "2 bright spots"),
        ([target, frame((40, 50, 21, 100.0))], "more than 1 %"),
        ([taken(np.full((3, 4), 10.0))], "pixels and the background")):  # fmt: skip
        raises(DataError, said, calibrate_meter, frames, background, 1e-6)
    # A straight edge of 28 pixels: 0.25 to 0.75 of it are 14 pixels, of a Gaussian 10.4 of deviation.
    ramp = np.clip(np.minimum(np.arange(160) - 20, 139 - np.arange(160)) / 28, 0, 1)
    soft = np.tile(10.0 + 100 * ramp, (120, 1))
    soft[:20] = soft[100:] = 10.0
    raises(DataError, "blurred over", calibrate_meter, [taken(soft)] * 2, background, 1e-6)


# What a camera sees without a finger


def learnt(*images: np.ndarray) -> Background:
    camera: Any = SimpleNamespace(read=map(taken, images).__next__)
    return learn_background(camera, len(images))


def test_the_noise_is_that_from_frame_to_frame():
    chess = 10.0 + 2.0 * (-1.0) ** np.add.outer(np.arange(SHAPE[0]), np.arange(SHAPE[1]))
    found = learnt(chess, 20.0 - chess, chess)
    # A pixel differs by 4 from one frame to the next: half of a Gaussian's differences are below 0.954.
    assert found.noise == pytest.approx(4 / 0.954)
    np.testing.assert_allclose(found.mean, (20.0 + chess) / 3)
    quiet = learnt(*3 * [np.full(SHAPE, 10.0)])
    assert quiet.noise == 0.3 and quiet.mean.min() == quiet.mean.max() == 10.0
    with pytest.raises(FrozenInstanceError):
        quiet.noise = 1.0


@pytest.mark.parametrize(
    ("share", "level", "refused"), [(0.015, 255.0, True), (0.015, 200.0, False), (0.005, 255.0, False)]
)
def test_a_background_is_too_bright_where_a_hundredth_of_it_is(share, level, refused):
    image = np.full(SHAPE, 10.0)
    image.flat[: round(share * image.size)] = level
    if refused:
        raises(DataError, "too bright", learnt, image, image)
    else:
        assert learnt(image, image).noise == 0.3


def test_a_black_image_is_a_closed_lens_and_a_dark_one_is_not():
    black, flicker = np.zeros(SHAPE), np.zeros(SHAPE)
    raises(DataError, "is black", learnt, black, black)
    flicker[0, 0] = 1.0
    assert learnt(flicker, flicker).mean.max() == 1.0


@pytest.mark.parametrize(("change", "refused"), [(4.0, False), (-4.0, False), (4.5, True), (-4.5, True)])
def test_what_moves_is_no_background(change, refused):
    still, moved = np.full(SHAPE, 20.0), np.full(SHAPE, 20.0)
    moved[40:60, 50:70] += change
    if refused:
        raises(DataError, "Something moved", learnt, still, still, moved)
    else:
        assert learnt(still, still, moved).noise == 0.3


@pytest.mark.parametrize(
    ("kept", "slow", "took", "read"),
    [(0, (), 0.6, 2), (3, (), 0.6, 5), (3, (1,), 0.6, 5), (100, (), 0.6, 30), (0, (), 0.5, 30)],
)
def test_frames_are_dropped_until_two_in_a_row_take_their_time(kept, slow, took, read):
    """`took` is in times between two frames, an eighth of a second, also of those kept that are `slow`."""
    times, now = [], 0.0

    def one():
        nonlocal now
        now += 0.0 if len(times) < kept and len(times) not in slow else took * 0.125
        times.append(now)

    camera: Any = SimpleNamespace(read=one, rate_hz=8.0)
    clock: Any = SimpleNamespace(now=lambda: now)
    drop_old_frames(camera, clock)
    assert len(times) == read


def test_light_that_has_changed_is_told_before_the_blobs_that_it_makes():
    two = ((40, 30, 20, 60.0), (40, 90, 20, 60.0))
    assert "more than one finger" in seen(*two).problem
    found = seen(*two, light=40.0)
    assert found.others == 1 and found.problem.startswith("The light changed by +40")


@pytest.mark.parametrize(("deviation", "sharp"), [(4.8, True), (5.2, False)])
def test_an_edge_of_a_known_deviation_is_sharp_up_to_five_pixels(deviation, sharp):
    """A disc behind a Gaussian blur, of which the average over 3 x 3 pixels is a part: 2/3 of variance."""
    rows, columns = np.mgrid[: SHAPE[0], : SHAPE[1]]
    inside = 36 - np.hypot(rows - 60, columns - 80)
    soft = 10.0 + 100 * scipy.special.ndtr(inside / np.sqrt(deviation**2 - 2 / 3))
    background = Background(np.full(SHAPE, 10.0), 0.3)
    if sharp:
        area = calibrate_meter([taken(soft)] * 2, background, 1e-6 * np.pi * 36**2).square_metres
        assert area == pytest.approx(1e-6, rel=0.02)
    else:
        with pytest.raises(DataError, match=r"blurred over 5\.[23] pixels"):
            calibrate_meter([taken(soft)] * 2, background, 1e-6)
