"""What a rig has opened is frozen: the limits of a play rest on it."""

from __future__ import annotations

from typing import Any, NoReturn, TypeVar

from pydantic import BaseModel

from ..base.errors import ConfigurationError

Key = TypeVar("Key")
Value = TypeVar("Value")
Model = TypeVar("Model", bound=BaseModel)


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


def _refuse(*_given: object, **_named: object) -> NoReturn:
    raise ConfigurationError(
        "What a rig file says cannot be changed in the program: change the file, and open the rig again."
    )


class FrozenDict(dict[Key, Value]):
    """A dictionary of a rig file, which nobody changes after it was read. A copy of it is a plain one."""

    __setitem__ = __delitem__ = __ior__ = _refuse
    update = clear = pop = popitem = setdefault = _refuse

    def __reduce__(self) -> tuple[type[dict[Key, Value]], tuple[dict[Key, Value]]]:
        """Copies, deep ones and pickles are of a plain dictionary."""
        return dict, (dict(self),)


class FrozenList(list[Value]):
    """A list of a rig file, as `FrozenDict`."""

    __setitem__ = __delitem__ = __iadd__ = __imul__ = _refuse
    append = extend = insert = remove = pop = clear = sort = reverse = _refuse

    def __reduce__(self) -> tuple[type[list[Value]], tuple[list[Value]]]:
        """Copies, deep ones and pickles are of a plain list."""
        return list, (list(self),)


class FrozenSet(set[Value]):
    """A set of a driver's settings, as `FrozenDict`; what pydantic writes must be a set."""

    __ior__ = __iand__ = __isub__ = __ixor__ = _refuse
    add = discard = remove = pop = clear = update = _refuse
    difference_update = intersection_update = symmetric_difference_update = _refuse

    def __reduce__(self) -> tuple[type[set[Value]], tuple[set[Value]]]:
        """Copies, deep ones and pickles are of a plain set."""
        return set, (set(self),)


def frozen(value: Any) -> Any:
    """Return a value of a rig file with every dictionary, list and set in it frozen."""
    if isinstance(value, dict):
        return FrozenDict({key: frozen(one) for key, one in value.items()})
    if isinstance(value, list):
        return FrozenList(map(frozen, value))
    if type(value) is tuple:  # a named one is made otherwise
        return tuple(map(frozen, value))
    if isinstance(value, BaseModel):
        return frozen_fields(value)
    return FrozenSet(value) if isinstance(value, set) else value


def frozen_fields(model: Model) -> Model:
    """Freeze every dictionary, list and set in the fields of settings, and return these."""
    vars(model).update({name: frozen(value) for name, value in vars(model).items()})
    return model
