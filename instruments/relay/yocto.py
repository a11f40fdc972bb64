"""Yocto-MaxiCoupler behind a VirtualHub or YoctoHub, over the hub's REST interface.

The vendor's libraries report success for a command that the hub answered with 404, and one of them
hangs for ever when the hub dies (docs/hardware.md, "Relay box"), so haploop has its own client: each
request has a hard deadline, and no reply is trusted until the state has been read back. A hub
that asks for a password is not supported.

The dead-man is the box's own pulse timer, restarted by each renewal; `maxTimeOnStateB` is a second,
outer bound, which a renewal is not assumed to extend (docs/hardware.md, "Relay box").
"""

from __future__ import annotations

import json
import math
import socket
from collections.abc import Collection, Mapping
from io import BufferedReader, RawIOBase
from typing import Annotated, Any, Self, TypeVar, cast
from urllib.parse import urlencode, urlsplit

from pydantic import AfterValidator, BaseModel, Field, ValidationError, model_validator

from ...base.bounded import Positive, Timeout
from ...base.clock import Clock, RealClock
from ...base.errors import ConfigurationError, InstrumentError
from ...base.validation import told
from ..config import RatingSource, require_source
from ..driver import one_name
from ..tape import Failure, taped_line
from .board import BoardSettings, ChannelRelay, ChannelState, read_back

CHANNELS = 8
"""Channels of a box (docs/hardware.md, "Relay box")."""
_PRODUCT = "Yocto-MaxiCoupler"
_RATING = 48.0
_PORT = 4444
_PATIENCE_LAN = 1.0
"""Time for a command to show in the read-back through a hub in the network (s; estimate)."""
_OPEN_AT_POWER_ON = 1
"""`stateAtPowerOn`: 0 is as before, 1 is A, 2 is B (docs/hardware.md, "Relay box")."""
_SERIAL = r"^[A-Za-z0-9]{1,12}-[A-Za-z0-9]{1,12}$"
_LONGEST_REPLY = 1 << 20
"""Longest reply (bytes); the description of a module has a few thousand."""


def _address(hub: str) -> str:
    parts = urlsplit(hub)
    if parts.scheme != "http" or not parts.hostname or parts.path.strip("/") or parts.query:
        raise ValueError("give the hub as http://HOST:PORT")
    if parts.username:
        raise ValueError("a hub with a password is not supported; switch its password off")
    host = f"[{parts.hostname}]" if ":" in parts.hostname else parts.hostname
    return f"http://{host}:{parts.port or _PORT}"


class Yocto(ChannelRelay):
    """See `Relay` and `ChannelRelay`."""

    taped = True

    class Settings(BoardSettings):
        """The `[relay]` table of a rig file."""

        patches: Annotated[
            dict[str, Annotated[int, Field(strict=True, ge=1, le=CHANNELS)]],
            Field(min_length=1, max_length=CHANNELS),
        ]
        """Channel of each patch, 1 to 8."""
        hub: Annotated[str, AfterValidator(_address)] = f"http://127.0.0.1:{_PORT}"
        serial: Annotated[str, Field(pattern=_SERIAL)] | None = None
        """Serial number; without it, the only Yocto-MaxiCoupler that the hub has."""
        rating: Positive = _RATING
        """DC rating of the V2 (V); its 30 V AC rms is not checked, and the V1's rating was not found
        (docs/hardware.md, "Relay box")."""
        dead_man: Annotated[float, Field(strict=True, ge=0.1, le=60)] = 2.0
        """Time after which the box opens by itself unless renewed (s)."""
        longest: Annotated[float, Field(strict=True, gt=0, le=3600)] = 120.0
        """Time after which the box opens a channel even when it is renewed (s)."""
        timeout: Timeout = 1.0
        """Time for the hub to answer a request completely (s)."""

        rating_source: RatingSource = None

        @property
        def waits(self) -> float:
            """See `BoardSettings.waits`: a hub in the network passes commands on one by one."""
            here = urlsplit(self.hub).hostname in ("127.0.0.1", "localhost", "::1")
            return self.patience or (super().waits if here else _PATIENCE_LAN)

        @model_validator(mode="after")
        def _ordered(self) -> Self:
            if self.rating > _RATING:
                require_source(_PRODUCT, "rating", self.rating, _RATING, self.rating_source)
            if self.longest < self.dead_man:
                raise ValueError("longest must not be less than dead_man")
            return self

    @staticmethod
    def hardware(settings: Settings) -> tuple[str, ...]:
        """See `Driver.hardware`: the box by its serial number, whatever a rig file calls it and its hub.

        Without `serial` the hub is asked. One that does not answer, or has no single box, is named by its
        address: nothing can be switched there now.
        """
        if settings.serial:
            return (_named(settings.serial),)
        try:
            return (_named(_only_box(_Hub(settings.hub, settings.timeout))),)
        except (ConfigurationError, InstrumentError):
            return (f"{one_name(settings.hub)} its only box",)

    @classmethod
    def open(cls, settings: Settings, clock: Clock) -> Self:
        """Find the box, check its identity and set its outer time limit; no channel is changed.

        Raises ConfigurationError when the hub has no such box, or several and no `serial` is
        given; InstrumentError when the hub does not answer as a hub does.
        """
        board = _Board(settings)
        channels = settings.patches.values()
        board.limit_time(channels, settings.longest)
        read_back(
            lambda: board.limit_complaint(channels, settings.longest), clock, settings.settle, settings.waits
        )
        return cls(settings, clock, board)

    @property
    def pieces(self) -> tuple[str, ...]:
        """What `hardware` names, by the number of the box that was opened."""
        assert isinstance(self._board, _Board)
        return (_named(self._board.serial),)

    def power_on_complaint(self) -> str:
        """See `Relay.power_on_complaint`."""
        assert isinstance(self._board, _Board)
        states = {patch: self._board.at_power_on(channel) for patch, channel in self._channels.items()}
        closing = [patch for patch, state in states.items() if state not in (_OPEN_AT_POWER_ON, None)]
        timed = [patch for patch, channel in self._channels.items() if self._board.closes_by_itself(channel)]
        if timed:
            return (
                f"{self.identity}: the channel of patch {', '.join(timed)} closes by itself after a time: "
                "set its 'maximum time on state A' to 0 in VirtualHub, and save that to the module's flash."
            )
        if not closing:
            return ""
        return (
            f"{self.identity}: the channel of patch {', '.join(closing)} may close by itself when the box "
            "gets power: set its 'state at power on' to A in VirtualHub, and save that to the module's flash."
        )


class _Board:
    """A `RelayBoard`: one module on a hub."""

    def __init__(self, settings: Yocto.Settings) -> None:
        self.dead_man = settings.dead_man
        self.identity = f"The {_PRODUCT} at {settings.hub}"
        self._hub = _Hub(settings.hub, settings.timeout)
        self.serial = serial = settings.serial or _only_box(self._hub)
        self._root = f"/bySerial/{serial}"
        module = _checked(self.identity, _Module, self._tree().get("module"))
        if module.serial != serial:
            raise InstrumentError(
                f"The hub {settings.hub} answered for {module.serial} when asked for {serial}: restart it."
            )
        self.identity = f"{module.product} {serial}"

    def states(self) -> Mapping[int, ChannelState]:
        return {
            channel: ChannelState(
                closed=relay.state == 1, remaining=relay.pulse / 1000 if relay.pulse else math.inf
            )
            for channel, relay in self._relays().items()
        }

    def at_power_on(self, channel: int) -> int | None:
        found = self._relays().get(channel)
        return found.at_power_on if found else None

    def closes_by_itself(self, channel: int) -> bool:
        found = self._relays().get(channel)
        return found is not None and bool(found.longest_open)

    def open_channel(self, channel: int) -> None:
        self._set(channel, "state", 0)

    def close_channel(self, channel: int) -> None:
        self._set(channel, "pulseTimer", _ms(self.dead_man))

    def limit_time(self, channels: Collection[int], longest: float) -> None:
        for channel in channels:
            self._set(channel, "maxTimeOnStateB", _ms(longest))

    def limit_complaint(self, channels: Collection[int], longest: float) -> str:
        """Describe a channel that has not taken its time limit; empty when all have."""
        relays = self._relays()
        for channel in channels:
            if channel not in relays:
                return f"{self.identity} has no channel {channel}: correct 'patches' in [relay]."
            if relays[channel].longest != _ms(longest):
                return (
                    f"{self.identity}: channel {channel} was given a time limit of {_ms(longest)} ms "
                    f"but reads {relays[channel].longest}: check the box's cable, and then its firmware."
                )
        return ""

    def release(self) -> None:
        """Do nothing: each request has its own connection."""

    def _set(self, channel: int, attribute: str, value: int) -> None:
        query = urlencode({"scr": "", "ctx": f"relay{channel}", attribute: value})
        self._hub.get(f"{self._root}/api?{query}")

    def _relays(self) -> dict[int, _Function]:
        tree = self._tree()
        names = {channel: f"relay{channel}" for channel in range(1, CHANNELS + 1)}
        return {
            c: _checked(self.identity, _Function, tree[name]) for c, name in names.items() if name in tree
        }

    def _tree(self) -> dict[str, Any]:
        return self._hub.json(f"{self._root}/api.json")


def _ms(seconds: float) -> int:
    return round(seconds * 1000)


class _Module(BaseModel):
    serial: Annotated[str, Field(alias="serialNumber", pattern=_SERIAL)]
    product: Annotated[str, Field(alias="productName", max_length=80)]


class _Listing(BaseModel):
    modules: Annotated[list[_Module], Field(alias="whitePages", strict=False)]


class _Function(BaseModel):
    """One relay: state 0 is A, open and idle; 1 is B. Times in ms."""

    state: Annotated[int, Field(strict=True, ge=0, le=1)]
    pulse: Annotated[int, Field(alias="pulseTimer", ge=0, lt=1 << 32)]
    longest: Annotated[int, Field(alias="maxTimeOnStateB", ge=0, lt=1 << 32)]
    at_power_on: Annotated[int | None, Field(alias="stateAtPowerOn", ge=0, le=2)] = None
    longest_open: Annotated[int, Field(alias="maxTimeOnStateA", ge=0, lt=1 << 32)] = 0


_Reply = TypeVar("_Reply", bound=BaseModel)


def _checked(identity: str, kind: type[_Reply], value: object) -> _Reply:
    try:
        return kind.model_validate(value, strict=True)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(map(str, first["loc"])) or "its answer"
        raise InstrumentError(
            f"{identity} sent an answer that cannot be right: {key} {told(first)} "
            f"(found {str(first['input'])[:60]!r})."
        ) from None


class _Hub:
    """A client for one hub: a connection and a deadline for each request."""

    def __init__(self, url: str, timeout: float) -> None:
        self.url = url
        self._timeout = timeout
        self._host = urlsplit(url).netloc
        self._line = taped_line()

    def json(self, path: str) -> dict[str, Any]:
        """Get the JSON object at a path. Raises InstrumentError."""
        body = self.get(path)
        try:
            tree = json.loads(body)
        except (ValueError, RecursionError):
            raise InstrumentError(
                f"The hub {self.url} sent something else than whole JSON for {path} "
                f"({len(body)} bytes): is it a VirtualHub?"
            ) from None
        if not isinstance(tree, dict):
            raise InstrumentError(f"The hub {self.url} sent no JSON object for {path}: is it a VirtualHub?")
        return tree

    def get(self, path: str) -> bytes:
        """Get the body at a path, complete within the deadline. Raises InstrumentError."""
        body: bytes
        try:
            status, body = self._line.call("GET", lambda: self._got(path), path, failures=_FAILURES)
        except TimeoutError:
            raise InstrumentError(
                f"The hub {self.url} did not answer within {self._timeout:g} s: is it running?"
            ) from None
        except ConnectionError as error:
            # The error may quote the hub's reply, which can be anything.
            reason = " ".join(str(error).split())[:200] or type(error).__name__
            raise InstrumentError(
                f"The hub {self.url} cannot be talked to ({reason}): "
                "start VirtualHub, or correct 'hub' in [relay]."
            ) from None
        if status == 401:
            raise InstrumentError(
                f"The hub {self.url} asks for a password, which is not supported: switch it off."
            )
        if status != 200:
            raise InstrumentError(
                f"The hub {self.url} answered {path} with status {status}: is the module plugged in?"
            )
        return body

    def _got(self, path: str) -> tuple[int, bytes]:
        """Status and body. Raises TimeoutError, ConnectionError."""
        # It loads ssl, which costs every command whose rig file names this driver more than the request.
        from http.client import HTTPException, HTTPResponse  # noqa: PLC0415

        parts = urlsplit(self.url)
        request = f"GET {path} HTTP/1.1\r\nHost: {self._host}\r\nConnection: close\r\n\r\n"
        clock = RealClock()
        deadline = clock.now() + self._timeout
        try:
            with socket.create_connection((parts.hostname, parts.port), self._timeout) as link:
                link.sendall(request.encode("ascii"))
                reader = cast(socket.socket, _Deadlined(link, clock, deadline))
                with HTTPResponse(reader) as response:
                    response.begin()
                    return response.status, response.read(_LONGEST_REPLY)
        except TimeoutError:
            raise
        except (OSError, HTTPException, ValueError) as error:
            raise ConnectionError(str(error) or type(error).__name__) from None


_FAILURES = (Failure(TimeoutError), Failure(ConnectionError))


class _Deadlined(RawIOBase):
    """Reads a socket until a deadline, even when bytes arrive slowly."""

    def __init__(self, link: socket.socket, clock: Clock, deadline: float) -> None:
        self._link = link
        self._clock = clock
        self._deadline = deadline

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        left = self._deadline - self._clock.now()
        if left <= 0:
            raise TimeoutError
        self._link.settimeout(left)
        return self._link.recv_into(buffer)

    def makefile(self, mode: str) -> BufferedReader:
        """Return a reader: the only method of a socket that HTTPResponse calls."""
        return BufferedReader(self)


def _named(serial: str) -> str:
    return f"{_PRODUCT} {serial.upper()}"


def _only_box(hub: _Hub) -> str:
    """Serial number of a hub's only box. Raises ConfigurationError for none or several, InstrumentError."""
    tree = hub.json("/api.json")
    listed = _checked(f"The {_PRODUCT} at {hub.url}", _Listing, tree.get("services")).modules
    boxes = [m for m in listed if m.product.startswith(_PRODUCT)]
    if len(boxes) == 1:
        return boxes[0].serial
    found = ", ".join(f"{m.product} {m.serial}" for m in listed) or "nothing"
    raise ConfigurationError(
        f"The hub {hub.url} has {len(boxes) or 'no'} {_PRODUCT}{'s' * (len(boxes) > 1)} "
        f"(it lists {found}): "
        + ("name one by 'serial' in [relay]." if boxes else "plug it in, or correct 'hub' in [relay].")
    )
