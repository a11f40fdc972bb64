"""An imitation of the package `labjack.ljm`, as far as the driver calls it: one T7, DAC0 - DAC1 wired to
AIN10."""

# ruff: noqa: N802  names of the package

from __future__ import annotations

from typing import Any

import numpy as np

LOOPED = 10


class LJMError(Exception):
    pass


class FakeLjm:
    LJMError = LJMError

    def __init__(self) -> None:
        self.registers: dict[str, float] = {"DAC0": 0.0, "DAC1": 0.0}
        self.streaming: dict[str, Any] | None = None
        self.outs: dict[int, tuple[int, list[float]]] = {}
        self.lose_at: int | None = None
        """Scan from which a block is lost; None for never."""
        self.dies_at: int | None = None
        self.starves = False
        self.opened = 0

    def openS(self, deviceType: str = "ANY", connectionType: str = "ANY", identifier: str = "ANY") -> int:
        self.opened += 1
        return self.opened

    def getHandleInfo(self, handle: int) -> tuple[int, ...]:
        return (7, 1, 470012345, 0, 0, 64)

    def close(self, handle: int) -> None:
        pass

    def eWriteNames(self, handle: int, numFrames: int, aNames: list[str], aValues: list[float]) -> None:
        assert len(aNames) == len(aValues) == numFrames
        self.registers |= dict(zip(aNames, aValues, strict=True))

    def eReadName(self, handle: int, name: str) -> float:
        return self.registers[name]

    def initializeAperiodicStreamOut(
        self, handle: int, streamOutIndex: int, targetAddr: int, scanRate: float
    ) -> None:
        self.outs[streamOutIndex] = (targetAddr, [])

    def writeAperiodicStreamOut(
        self, handle: int, streamOutIndex: int, numValues: int, aWriteData: list[float]
    ) -> int:
        assert len(aWriteData) == numValues
        if not self.starves:
            self.outs[streamOutIndex][1].extend(aWriteData)
        return 16_384

    def eStreamStart(
        self, handle: int, scansPerRead: int, numAddresses: int, aScanList: list[int], scanRate: float
    ) -> float:
        if self.streaming is not None:
            raise LJMError("LJM library error code 2605 STREAM_IS_ACTIVE")
        assert len(aScanList) == numAddresses
        self.streaming = {"scans": scansPerRead, "list": aScanList, "rate": scanRate, "done": 0}
        return scanRate

    def eStreamRead(self, handle: int) -> tuple[list[float], int, int]:
        if self.streaming is None:
            raise LJMError("LJM library error code 1303 STREAM_NOT_RUNNING")
        scans, addresses = self.streaming["scans"], self.streaming["list"]
        first = self.streaming["done"]
        self.streaming["done"] += scans
        if self.dies_at is not None and first + scans > self.dies_at:
            raise LJMError("LJM library error code 1239 LJME_RECONNECT_FAILED")
        inputs = [address for address in addresses if address < 4800]
        data = np.zeros((scans, len(inputs)))
        for scan in range(scans):
            for target, values in self.outs.values():
                if any(address >= 4800 for address in addresses) and values:
                    self.registers[f"DAC{(target - 1000) // 2}"] = values.pop(0)
            for row, address in enumerate(inputs):
                if address == 2 * LOOPED:
                    data[scan, row] = self.registers["DAC0"] - self.registers["DAC1"]
        if self.lose_at is not None and first + scans > self.lose_at:
            data[:] = -9999.0
        room = [0.0] * (scans * (len(addresses) - len(inputs)))
        return [*data.ravel().tolist(), *room], 0, 0

    def eStreamStop(self, handle: int) -> None:
        if self.streaming is None:
            raise LJMError("LJM library error code 1303 STREAM_NOT_RUNNING")
        self.streaming, self.outs = None, {}
