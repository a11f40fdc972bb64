"""Devices of a simulated NI system, the names of their terminals, and the NI MAX exports that list them."""

from __future__ import annotations

import configparser
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace

from nidaqmx.constants import TerminalConfiguration

from .errors import DaqmxError, DAQmxErrors
from .names import names_in
from .products import Product, described
from .scales import Scale, scale_from_export

CONFIGURATIONS = {
    "rse": TerminalConfiguration.RSE,
    "nrse": TerminalConfiguration.NRSE,
    "diff": TerminalConfiguration.DIFF,
    "pseudodiff": TerminalConfiguration.PSEUDO_DIFF,
}
"""NI's terminal configurations by the names of the table of products."""

_TERMINAL = re.compile(
    r"(ai|ao|di|do|te\d)/(SampleClock|SampleClockTimebase|StartTrigger|ReferenceTrigger|PauseTrigger"
    r"|ConvertClock|ConvertClockTimebase|HoldCompleteEvent|HoldComplete)"
    r"|(PFI|APFI|RTSI|PXI_Trig|ao|ai)\d+|Ctr\d+(InternalOutput|Gate|Source|Aux|A|B|Z|SampleClock|ArmStartTrigger)"
    r"|ChangeDetectionEvent|AnalogComparisonEvent|OnboardClock|\w*MHzTimebase|100kHzTimebase|13MHz\w*"
    r"|10MHzRefClock|PXI_Clk10|PXIe_Clk100|MasterTimebase|FrequencyOutput|WatchdogExpiredEvent",
    re.IGNORECASE,
)

_NUMBERED = re.compile(r"(PFI|APFI|RTSI|PXI_Trig|ao|ai|Ctr)(\d+)\w*", re.IGNORECASE)
_LINES = 8
"""RTSI and PXI trigger lines of a card with such a bus (NI-DAQmx Key Concepts, "Synchronization": PCI devices
have the one, PXI devices the other)."""

_OF_CHASSIS = re.compile(r"(ai|ao|di|do|te\d)/|Ctr\d|ChangeDetectionEvent", re.IGNORECASE)
"""Terminals that a chassis has, and its modules have not: a program names the chassis (a maintainer in pull
request 589 of ni/nidaqmx-python)."""


def _spelt(tail: str) -> str:
    """Write a counter's terminal as the driver does, however a program has written it."""
    return re.sub(r"^ctr(\d+)internaloutput$", r"Ctr\1InternalOutput", tail, flags=re.IGNORECASE)


@dataclass(frozen=True)
class NiDevice:
    """One card, module or chassis in the NI system."""

    name: str
    product: Product
    serial: int | None = None
    """Serial number; 0 is none, and None one that the server gives: no two devices have the same."""
    simulated: bool = True
    """Value that the driver reports; every device here is in fact simulated."""
    chassis: str | None = None
    slot: int = 0
    number: int = 0
    """Product number; 0 means the product's own."""

    def full(self, text: str) -> str:
        """Return the full name of one of the device's terminals; one that is full stays as it is."""
        home = self.chassis if self.chassis and _OF_CHASSIS.match(text) else self.name
        return text if text.startswith("/") else f"/{home}/{_spelt(text)}"

    def has_terminal(self, text: str) -> bool:
        """True when `text`, without the device, names one of its terminals.

        What is not known of a product, such as the PFI lines of some, limits no number.
        """
        if not _TERMINAL.fullmatch(text):
            return False
        numbered = _NUMBERED.fullmatch(text)
        if numbered is None:
            return True
        most = {
            "pfi": self.product.pfi_lines,
            "rtsi": 0 if self.product.name.startswith("USB") else _LINES,
            "pxi_trig": _LINES if self.product.name.startswith("PXI") else 0,
            "ao": len(self.ao),
            "ai": len(self.ai),
            "ctr": self.product.counters,
        }.get(numbered[1].lower())
        return most is None or int(numbered[2]) < most

    @property
    def ai(self) -> list[str]:
        """Names of the analog inputs."""
        count = max(self.product.ai_single_ended, self.product.ai_differential)
        return [f"{self.name}/{tail}" for tail in self.product.ai_names or [f"ai{i}" for i in range(count)]]

    def ai_number(self, tail: str) -> int | None:
        """Number of an analog input; None of another terminal, and of one that has a name of its own."""
        digits = tail.removeprefix("ai")
        return int(digits) if tail.startswith("ai") and digits.isdecimal() else None

    @property
    def ao(self) -> list[str]:
        """Names of the analog outputs."""
        return [f"{self.name}/ao{i}" for i in range(self.product.ao_channels)]

    @property
    def ports(self) -> list[str]:
        """Names of the digital ports."""
        return [f"{self.name}/port{p}" for p in range(len(self.product.ports))]

    @property
    def lines(self) -> list[str]:
        """Names of the digital lines."""
        return [f"{self.name}/port{p}/line{i}" for p, n in enumerate(self.product.ports) for i in range(n)]

    @property
    def counters(self) -> list[str]:
        """Names of the counters; those of a chassis are internal, for its modules."""
        mark = "_" if self.product.slots else ""
        return [f"{self.name}/{mark}ctr{i}" for i in range(self.product.counters)]

    def lines_of(self, tail: str) -> list[str]:
        """Return the line `tail` itself, or all lines of a port in rising order; names without the device."""
        port = tail.removeprefix("port")
        if not port.isdecimal():
            return [tail]
        return [f"{tail}/line{i}" for i in range(self.product.ports[int(port)])]

    def listed(self, text: str) -> list[str]:
        """Return the lines that a list names, with the device also where it is left out ("port0/line0:3")."""
        names = (name.strip().lstrip("/") for name in names_in(text))
        return [f"{self.name}/{name}" if name.lower().startswith("port") else name for name in names]

    def port_way(self, port: int) -> str:
        """Direction of a port's lines: "in", "out" or "both"."""
        return self.product.port_ways[port] if self.product.port_ways else "both"

    def ways(self, way: str) -> tuple[list[str], list[str]]:
        """Names of the ports and of the lines that go the `way` "in" or "out"."""
        numbers = [p for p in range(len(self.product.ports)) if self.port_way(p) in (way, "both")]
        lines = [line for p in numbers for line in self.lines if line.startswith(f"{self.name}/port{p}/")]
        return [f"{self.name}/port{p}" for p in numbers], lines


@dataclass(frozen=True)
class Inventory:
    """All devices of the system, by name."""

    devices: Mapping[str, NiDevice]
    left_out: tuple[str, ...] = field(default=())
    """Sentences about devices of an export that cannot be simulated."""
    scales: Mapping[str, Scale] = field(default_factory=dict)
    """Custom scales of the system, by name."""
    export: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    """Sections of the export that it was made from, with the tasks and channels that are stored there."""

    @staticmethod
    def of(devices: Iterable[NiDevice]) -> Inventory:
        """Create an inventory of `devices`."""
        return Inventory({device.name: device for device in devices})

    def numbered(self, first: int) -> Inventory:
        """Return this inventory with serial numbers from `first` on, for the devices without."""
        return replace(
            self,
            devices={
                name: device if device.serial is not None else replace(device, serial=first + i)
                for i, (name, device) in enumerate(self.devices.items())
            },
        )

    def device(self, name: str) -> NiDevice:
        """Return the device called `name`, ignoring case as the driver does. Raises DaqmxError."""
        for device in self.devices.values():
            if device.name.lower() == name.strip().lower():
                return device
        raise DaqmxError(
            DAQmxErrors.INVALID_DEVICE_ID,
            f"Device identifier is invalid: there is no device {name.strip()!r}.\n\n"
            f"Device Specified: {name.strip()}",
        )

    def modules(self, chassis: str) -> list[NiDevice]:
        """Return the modules of a chassis in the order of their slots."""
        return sorted((d for d in self.devices.values() if d.chassis == chassis), key=lambda d: d.slot)

    def resolve(self, text: str) -> Iterator[tuple[NiDevice, str]]:
        """Yield each physical channel that `text` lists, as (device, name without the device).

        Lists and ranges follow the driver's syntax: "Dev1/ai0:3, Dev1/ai7", "Dev1/port0". Raises DaqmxError.
        """
        names = names_in(text)
        if not names:
            raise DaqmxError(DAQmxErrors.PHYSICAL_CHANNEL_NOT_SPECIFIED, "No physical channel is named.")
        for name in names:
            head, _, tail = name.strip().lstrip("/").partition("/")
            device = self.device(head)
            tail = tail.lower()
            if not tail or not self._exists(device, tail):
                raise DaqmxError(
                    DAQmxErrors.PHYSICAL_CHAN_DOES_NOT_EXIST,
                    f"Physical channel specified does not exist on this device: {name!r} "
                    f"({device.product.name}).",
                )
            yield device, tail

    def terminal(
        self,
        device: NiDevice,
        text: str,
        wrong: DAQmxErrors = DAQmxErrors.INVALID_ROUTING_SOURCE_TERMINAL_NAME_ROUTING,
    ) -> str:
        """Return the full name of a terminal, "/Dev1/PFI0", from any form of name.

        Raises DaqmxError with the code `wrong` when it is not a terminal.
        """
        if text.startswith("/"):
            head, _, tail = text[1:].partition("/")
            named = next((d for d in self.devices.values() if d.name.lower() == head.lower()), None)
            if named is not None and named.has_terminal(tail):
                return f"/{named.name}/{_spelt(tail)}"
        elif device.has_terminal(text) and not (device.chassis and _OF_CHASSIS.match(text)):
            return f"/{device.name}/{_spelt(text)}"
        elif text in (*device.ai, *device.lines):
            return text
        raise DaqmxError(
            wrong, f"Specified route cannot be satisfied, because the terminal {text!r} is not valid."
        )

    def routed(self, source: NiDevice, target: NiDevice) -> bool:
        """Return True when a signal of `source` reaches `target` without a cable."""
        homes = {d.chassis or d.name for d in (source, target)}
        return len(homes) == 1

    def written(self, device: NiDevice, text: str) -> str:
        """Return a terminal as the driver reports it after a program has set it.

        A full name is not checked before use. Raises DaqmxError for a short name that is not a terminal of
        `device`.
        """
        return text if text.startswith("/") else self.terminal(device, text)

    @staticmethod
    def _exists(device: NiDevice, tail: str) -> bool:
        own = (*device.ai, *device.ao, *device.lines, *device.ports, *device.counters)
        inner = tuple(f"_ao{i}_vs_aognd" for i in range(device.product.ao_channels))
        inner += ("_boardtempsensor_vs_aignd",) if device.product.family == "X Series" else ()
        return f"{device.name}/{tail}" in own or tail in inner


def devices_from_ini(text: str) -> Inventory:
    """Create the inventory that a text export of NI MAX lists; unknown products are left out."""
    export = configparser.ConfigParser(interpolation=None, strict=False, delimiters=("=",))
    export.optionxform = str  # type: ignore[method-assign,assignment]
    export.read_string(text)
    devices: dict[str, NiDevice] = {}
    left_out: list[str] = []
    for section in export.sections():
        kind, _, name = section.partition(" ")
        if kind not in ("DAQmxDevice", "DAQmxCDAQChassis", "DAQmxCDAQModule"):
            continue
        entry = export[section]
        product = described({}).get(entry.get("ProductType", ""))
        if product is None:
            left_out.append(f"{name} ({entry.get('ProductType', 'no product')}) is not known and left out.")
            continue
        devices[name] = NiDevice(
            name=name,
            product=product,
            serial=int(entry.get("DevSerialNum") or "0", 0),
            simulated=entry.get("DevIsSimulated", "1").strip() == "1",
            chassis=entry.get("CompactDAQ.ChassisDevName"),
            slot=int(entry.get("CompactDAQ.SlotNum") or "0", 0),
            number=int(entry.get("ProductNum") or "0", 0),
        )
    for device in [d for d in devices.values() if d.chassis and d.chassis not in devices]:
        left_out.append(f"{device.name} is left out, because its chassis {device.chassis} is.")
        del devices[device.name]
    sections = {section: dict(export[section]) for section in export.sections()}
    return Inventory(devices, tuple(left_out), _scales(export), sections)


def _scales(export: configparser.ConfigParser) -> dict[str, Scale]:
    scales = {}
    for section in export.sections():
        kind, _, name = section.partition(" ")
        scale = scale_from_export(export[section]) if kind == "DAQmxScale" else None
        if scale is not None:
            scales[name] = scale
    return scales
