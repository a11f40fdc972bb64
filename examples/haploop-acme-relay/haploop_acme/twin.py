"""Twin and wire of the RB-8: its protocol on haploop's simulated relay box."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from haploop.mocks.relay import Contacts, SimulatedBox, box_in
from haploop.mocks.transport import DirectLine, LineServer
from haploop_acme.relay import AcmeRelay


def reply(box: SimulatedBox, line: str) -> Sequence[str]:
    match line.split():
        case ["ID"]:
            return ["ACME RB-8 1.4"]
        case ["READ"]:
            return [" ".join(str(int(s.remaining * 1000) if s.closed else 0) for s in box.states().values())]
        case ["OPEN", channel]:
            box.set_state(int(channel), False)
        case ["CLOSE", channel, time]:
            box.pulse(int(channel), int(time) / 1000)
        case _:
            return ["ERROR"]
    return ["OK"]


def twin(settings: AcmeRelay.Settings, plant: Contacts) -> AcmeRelay:
    """Create the twin: the real driver's class, connected to a simulated board by calls."""
    box = box_in(plant, settings.patches)
    return AcmeRelay(settings, plant.clock, DirectLine(lambda line: reply(box, line)))


@contextmanager
def wire(settings: AcmeRelay.Settings, plant: Contacts) -> Iterator[dict[str, object]]:
    """Serve a simulated board; yield the settings that point the driver at it."""
    box = box_in(plant, settings.patches)
    with LineServer(lambda line: reply(box, line)) as server:
        yield {"port": f"socket://{server.address}"}
