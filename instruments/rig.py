"""A rig: every instrument that a rig file names, opened together and left in the safe state."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from types import TracebackType
from typing import Any, Literal, Self, TypeVar

import numpy as np

from instruments.alignment import align, find
from instruments.amplifier import Amplifier
from instruments.arrays import FloatArray
from instruments.clock import Clock
from instruments.daq import Block, Capture, Daq
from instruments.driver import Mode, Simulation
from instruments.errors import ConfigurationError, InstrumentError, LimitError
from instruments.generator import Generator, Sweep
from instruments.limits import Limits
from instruments.operator import ConfirmSettings, Operator
from instruments.player import Player
from instruments.relay import Relay
from instruments.rig_file import RigFile, Table
from instruments.sensors import Divider, Sensors
from instruments.signals import uninterrupted
from instruments.vibrometer import Vibrometer

__all__ = ["ROLES", "Rig"]

Role = TypeVar("Role")
_REST = 0.05
"""Seconds of zero drive before the relay switches: several time constants of the amplifier."""
_SLACK = 0.5
"""Seconds within which a generator has answered its trigger, and a block has come."""
_EXCESS = 1.1
"""Measured volts over the limit at which a play is stopped: more than the monitor's noise and gain."""


ROLES: dict[str, type[Any]] = {
    "daq": Daq,
    "amplifier": Amplifier,
    "relay": Relay,
    "vibrometer": Vibrometer,
    "generator": Generator,
    "player": Player,
    "operator": Operator,
}
"""The roles of a rig file's tables, in the order that they are opened in."""


class Rig:
    """Open instruments. Made by `open_rig`; a context whose exit reaches the safe state."""

    def __init__(self, file: RigFile, clock: Clock, simulation: Simulation | None, mode: Mode | None) -> None:
        self.file = file
        self.clock = clock
        self.simulation = simulation
        self.mode = mode
        self._roles: dict[str, Any] = {}
        self._confirmed: set[str] = set()
        self._stack = ExitStack()
        if simulation:
            self._stack.callback(simulation.close)

    def adopt(self, role: str, instrument: Any) -> None:
        """Take an open instrument, to be let go of when the rig is closed."""
        self._roles[role] = instrument
        if hasattr(instrument, "close"):
            self._stack.callback(instrument.close)

    def complete(self) -> None:
        """Every instrument is here: from now on, closing reaches the safe state first."""
        self._stack.callback(self.make_safe)

    @property
    def name(self) -> str:
        """The rig's name, from its file."""
        return self.file.name

    @property
    def simulated(self) -> bool:
        """Whether anything that this rig measures is simulated, as far as its cards tell."""
        return self.simulation is not None or self.daq.simulated

    @property
    def sensors(self) -> Sensors:
        """The rig's sensors."""
        return self.file.sensors

    @property
    def table(self) -> Table:
        """The touch table. Raises ConfigurationError for a rig that has none."""
        if self.file.table is None:
            raise ConfigurationError(f"The rig {self.name!r} has no [table]; this step needs one.")
        return self.file.table

    @property
    def daq(self) -> Daq:
        """The DAQ."""
        return self._role(Daq)

    @property
    def amplifier(self) -> Amplifier:
        """The amplifier. Raises ConfigurationError for a rig that has none."""
        return self._role(Amplifier)

    @property
    def relay(self) -> Relay:
        """The relay. Raises ConfigurationError for a rig that has none."""
        return self._role(Relay)

    @property
    def vibrometer(self) -> Vibrometer:
        """The vibrometer. Raises ConfigurationError for a rig that has none."""
        return self._role(Vibrometer)

    @property
    def generator(self) -> Generator:
        """The generator. Raises ConfigurationError for a rig that has none."""
        return self._role(Generator)

    @property
    def player(self) -> Player:
        """The player. Raises ConfigurationError for a rig that has none."""
        return self._role(Player)

    @property
    def operator(self) -> Operator:
        """The person at the rig, or their twin."""
        return self._role(Operator)

    @property
    def limits(self) -> Limits:
        """The strictest of the rig's own limits, the amplifier's, one patch's and the relay's."""
        return self.limits_for(1)

    def limits_for(self, patches: int) -> Limits:
        """As `limits`, with `patches` patches in parallel."""
        table = self.table
        patch = Limits(
            low=table.patch_low, high=table.patch_high, capacitance=patches * table.patch_capacitance
        )
        relay = Limits(low=-self.relay.rating, high=self.relay.rating)
        own = self.file.limits.limits()
        return own.within(patch).within(relay).within(self.amplifier.limits(patches))

    def confirm_settings(self) -> None:
        """Have the operator confirm, once, what no software can read. Raises InstrumentError."""
        declared = {self.vibrometer.identity: self.vibrometer.declared}
        if self._wired("player"):
            declared[self.player.identity] = self.player.declared
        for identity, sentence in declared.items():
            if not sentence or sentence in self._confirmed:
                continue
            if not self.operator.confirm(ConfirmSettings(sentence)):
                raise InstrumentError(
                    f"The operator did not confirm the settings of the {identity}: "
                    "set them as the rig file says, or change the rig file."
                )
            self._confirmed.add(sentence)

    def excite(
        self,
        drive: FloatArray,
        patches: Collection[str],
        channels: Sequence[str],
        tail: float = 0.0,
        progress: Callable[[float], None] = lambda _seconds: None,
    ) -> Capture:
        """Play a drive into patches and record channels on the drive's own clock.

        `drive` is (samples,) V at the patch at the table's rate; recording goes on for `tail`
        seconds of zero drive. The drive is checked against every limit before anything is
        written; the relay connects exactly `patches` while the output rests at zero, and opens
        again before this returns or raises. `progress` is told the seconds of each block.

        Whatever is wired to the amplifier's input plays: one of the DAQ's outputs, on the DAQ's
        clock, or the player. A player begins when it likes, on a clock of its own; the capture is
        then an `Aligned` one, moved to the drive's clock by what the drive monitor shows, and
        stopped when that shows more volts than the limits allow.

        Raises LimitError, ConfigurationError, InstrumentError.
        """
        rate_hz = self.table.rate_hz
        self.limits_for(len(patches)).check(drive, rate_hz)
        _refuse_tail(tail)
        count = len(drive) + max(1, round(tail * rate_hz))
        volts = self.amplifier.to_input(np.pad(drive, (0, count - len(drive))))
        if self._wired("player"):
            return self._excite_by_player(drive, patches, channels, count, progress)
        recorded, each = self._watched(patches, channels, progress)
        with (
            self._connected(patches),
            self.daq.stream(recorded, rate_hz, self._block, count, {self.amplifier.input: volts}) as stream,
        ):
            return _only(channels, stream.capture(each), count)

    def sweep(
        self,
        sweep: Sweep,
        patches: Collection[str],
        channels: Sequence[str],
        tail: float = 0.0,
        progress: Callable[[float], None] = lambda _seconds: None,
    ) -> Capture:
        """Let the generator sweep patches, as the paper's did, and record channels meanwhile.

        `sweep.amplitude` is V peak at the patch here; the generator gets what that is at the
        amplifier's input. Recording begins before the sweep and goes on for `tail` seconds after
        it, in which the output is off. No clock is shared and nothing is aligned: the capture has
        the sweep somewhere in it, and the drive monitor shows where.

        Raises LimitError, ConfigurationError, InstrumentError.
        """
        rate_hz = self.table.rate_hz
        _refuse_tail(tail)
        if not sweep.amplitude > 0:
            raise ConfigurationError(f"A sweep needs an amplitude above 0 V, and this has {sweep.amplitude}.")
        if not self._wired("generator"):
            raise ConfigurationError(
                f"The generator of the rig {self.name!r} is wired to {self.generator.output!r}, and its "
                f"amplifier's input is {self.amplifier.input!r}: give both the same name in the rig file."
            )
        pace = (sweep.stop_hz - sweep.start_hz) / sweep.duration
        t = np.arange(round(sweep.duration * rate_hz)) / rate_hz
        volts = sweep.amplitude * np.sin(2 * np.pi * (sweep.start_hz + pace * t / 2) * t)
        # A generator cannot fade its sweep out, nor take its mean off: what is checked of it ends with
        # its last whole half wave.
        whole = volts[: int(np.flatnonzero(np.diff(np.signbit(volts)))[-1]) + 1]
        replace(self.limits_for(len(patches)), end=np.inf, mean=np.inf).check(whole, rate_hz)
        peak = float(self.amplifier.to_input(np.array([sweep.amplitude]))[0])
        self.generator.configure(replace(sweep, amplitude=peak))

        triggered: list[float] = []
        ended = False
        recorded, each = self._watched(patches, channels, progress)

        def follow(block: Block) -> None:
            nonlocal ended
            each(block)
            if not triggered:
                self.generator.trigger()
                triggered.append(self.clock.now())
            elif not ended and self.clock.now() >= triggered[0] + sweep.duration:
                self.generator.off()
                ended = True

        total = round((sweep.duration + tail + _SLACK) * rate_hz)
        with self._connected(patches):
            self.generator.arm()
            with self.daq.stream(recorded, rate_hz, self._block, total) as stream:
                capture = _only(channels, stream.capture(follow), total)
        if not ended:
            raise InstrumentError(
                f"The sweep of the {self.generator.identity} had not ended when recording ended: it was too "
                "late to follow its trigger. Try again, and check its cable."
            )
        return capture

    def make_safe(self) -> None:
        """Nothing plays, outputs at zero, then every relay channel open, read back. Idempotent.

        Everything is tried whatever the others do. Raises InstrumentError when any failed.
        """
        failures = []
        steps: tuple[tuple[str, Callable[[Any], object]], ...] = (
            ("player", lambda player: player.stop()),
            ("daq", lambda daq: daq.zero()),
            ("generator", lambda generator: generator.off()),
            ("relay", lambda _: self.clock.sleep(_REST)),
            ("relay", lambda relay: relay.connect(())),
        )
        for role, step in steps:
            if role not in self._roles:
                continue
            try:
                step(self._roles[role])
            except Exception as error:
                failures.append(error)
        if failures:
            raise InstrumentError(
                "The safe state was not confirmed: "
                + " ".join(str(f) for f in failures)
                + " Switch the amplifier off by hand."
            ) from failures[0]

    def close(self) -> None:
        """Safe state first, then let go of the instruments in reverse order. May be called again."""
        with uninterrupted():
            self._stack.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _excite_by_player(
        self,
        drive: FloatArray,
        patches: Collection[str],
        channels: Sequence[str],
        count: int,
        progress: Callable[[float], None],
    ) -> Capture:
        rate_hz, monitor = self.table.rate_hz, self._monitor()
        recorded, each = self._watched(patches, channels, progress)
        row = recorded.index(monitor.channels[0])
        total = count + round(self.player.room * rate_hz)
        with (
            self._connected(patches),
            self.daq.stream(recorded, rate_hz, self._block, total) as stream,
            self.player.play(self.amplifier.to_input(drive), rate_hz),
        ):
            capture = stream.capture(each)
        if drive.any():
            measured = monitor.to_si(capture.volts[[row]])[0]
            delay = float(capture.delays[row])
            capture = align(capture, find(measured, drive, rate_hz, delay, self.player.response), count)
        return _only(channels, capture, count)

    @property
    def _block(self) -> int:
        return round(self.table.rate_hz / 10)

    @contextmanager
    def _connected(self, patches: Collection[str]) -> Iterator[None]:
        """Exactly these patches, with nothing played before, and the safe state after."""
        try:
            self.daq.zero()
            self.relay.connect(patches)
            yield
        finally:
            # Zero first: the relay switches without voltage, and a patch is left without charge.
            with uninterrupted():
                self.make_safe()

    def _watched(
        self, patches: Collection[str], channels: Sequence[str], progress: Callable[[float], None]
    ) -> tuple[tuple[str, ...], Callable[[Block], None]]:
        """What to record, the drive monitor among it, and what is done with every block.

        The relay's dead man, and who waits, are told; more volts at the patch than the limits allow
        are an InstrumentError, whoever plays: a gain that is not what the rig file says, say.
        """
        limits, monitor = self.limits_for(len(patches)), self.file.sensors.drive
        recorded = tuple(dict.fromkeys([*channels, *(monitor.channels if monitor else ())]))

        def each(block: Block) -> None:
            self.relay.renew()
            if monitor is not None:
                row = recorded.index(monitor.channels[0])
                try:
                    limits.check_measured(monitor.to_si(block.volts[[row]])[0], _EXCESS)
                except LimitError as error:
                    raise InstrumentError(
                        f"{error} The play was stopped. Check the amplifier's gain, and a player's volume "
                        "and 'volts_per_full_scale'."
                    ) from None
            progress(block.volts.shape[1] / self.table.rate_hz)

        return recorded, each

    def _wired(self, role: Literal["player", "generator"]) -> bool:
        """Whether that is what feeds the amplifier."""
        return role in self._roles and self._roles[role].output == self.amplifier.input

    def _monitor(self) -> Divider:
        if self.file.sensors.drive is None:
            raise ConfigurationError(
                f"The rig {self.name!r} has a player and no [sensors.drive]: what a player plays is known "
                "only by what is measured of it, so wire the drive to a channel of the DAQ."
            )
        return self.file.sensors.drive

    def _role(self, kind: type[Role]) -> Role:
        name = kind.__name__.lower()
        instrument = self._roles.get(name)
        if not isinstance(instrument, kind):
            raise ConfigurationError(f"The rig {self.name!r} has no [{name}]; this step needs one.")
        return instrument


def _only(channels: Sequence[str], capture: Capture, samples: int) -> Capture:
    """The channels that were asked for, and no more than `samples`."""
    rows = [capture.channels.index(channel) for channel in channels]
    return replace(
        capture,
        channels=tuple(channels),
        volts=capture.volts[rows, :samples],
        delays=capture.delays[rows],
        overload=capture.overload[rows],
    )


def _refuse_tail(tail: float) -> None:
    if not 0 <= tail < np.inf:
        raise ConfigurationError(f"Recording can go on for 0 s or more after a drive, not for {tail} s.")
