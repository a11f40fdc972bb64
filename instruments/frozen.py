"""What a rig has opened is frozen: the limits of a play rest on it."""

from __future__ import annotations

from haploop.instruments.errors import ConfigurationError

__all__ = ["Frozen"]


class Frozen:
    """Base of what cannot be assigned to once a rig has opened it.

    The public data are: what the classes annotate, and what the object had when it was frozen. Methods are
    not (a test may replace one), nor is what begins with an underscore.
    """

    _frozen: frozenset[str] = frozenset()

    def _freeze(self) -> None:
        """Allow no assignment to the public data from now on."""
        annotated = {name for base in type(self).__mro__ for name in vars(base).get("__annotations__", ())}
        self._frozen = frozenset(name for name in annotated | set(vars(self)) if not name.startswith("_"))

    def __setattr__(self, name: str, value: object) -> None:
        if name in self._frozen:
            raise ConfigurationError(
                f"{name!r} of an open rig's {type(self).__name__} cannot be assigned to, because the "
                "limits of a play rest on it: change the rig file, and open the rig again."
            )
        super().__setattr__(name, value)

    def __delattr__(self, name: str) -> None:
        if name in self._frozen:
            self.__setattr__(name, None)
        super().__delattr__(name)
