"""Tolerances of the company in a file of the store, for all machines and for single machines.

[all]
volumetric-rms = 15.0
[machine."Mill 7"]
volumetric-rms = 8.0
C0Y = 20.0
"""

from collections.abc import Mapping, Sequence
from typing import Annotated

from msgspec import Meta, Struct, field

from stepdiag.base.errors import UsageError
from stepdiag.base.files import HASH_SUFFIX, LARGEST_SETTINGS_BYTES, as_text, require_hash
from stepdiag.base.messages import message
from stepdiag.base.settings import convert, read_toml
from stepdiag.fleet.series import Series
from stepdiag.fleet.store import Store

FILE = "tolerances.toml"

Largest = Annotated[float, Meta(gt=0, le=1e6)]


class Tolerances(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Largest permitted magnitude of each quantity in its unit; the tolerance of a single machine
    has priority over that of all machines."""

    all: dict[str, Largest] = field(default_factory=dict)
    machine: dict[str, dict[str, Largest]] = field(default_factory=dict)

    def of(self, machine: str, quantity: str) -> float | None:
        """Return the tolerance of a quantity of a machine, None without a tolerance."""
        return self.machine.get(machine, {}).get(quantity, self.all.get(quantity))

    def together_with(self, given: Mapping[str, float]) -> "Tolerances":
        """Return the tolerances of the file together with the tolerances ``given``, which apply to
        every machine and have priority."""
        own = {
            name: {quantity: value for quantity, value in of.items() if quantity not in given}
            for name, of in self.machine.items()
        }
        return Tolerances(all={**self.all, **given}, machine=own)


def tolerances_in(store: Store) -> Tolerances:
    """Return the tolerances in the store's file, empty without a file.

    Raises UsageError for an invalid file. Raises DataError if a hash file exists and contains
    another hash (``sha256sum tolerances.toml > tolerances.toml.sha256``).
    """
    if not store.exists(FILE):
        return Tolerances()
    data, beside = store.read(FILE, largest=LARGEST_SETTINGS_BYTES), FILE + HASH_SUFFIX
    if store.exists(beside):
        require_hash(
            data,
            store.read(beside, largest=LARGEST_SETTINGS_BYTES),
            f"{store.address}: {FILE}",
            beside,
        )
    text = as_text(data, FILE, UsageError)
    return convert(read_toml(text, FILE), Tolerances, FILE)


def require_known(tolerances: Tolerances, series: Sequence[Series], source: str) -> None:
    """Raise UsageError for a tolerance of a quantity that no machine of the store has; the name is
    then mistyped."""
    known = {each.quantity for each in series}
    unknown = sorted(
        {*tolerances.all, *(name for of in tolerances.machine.values() for name in of)}
        - known
    )
    if unknown:
        raise UsageError(
            source, expected=message("one-of", names=sorted(known)), found=", ".join(unknown)
        )
    for machine, of in tolerances.machine.items():
        _require_of(machine, of, series, source)


def _require_of(
    machine: str, of: Mapping[str, float], series: Sequence[Series], source: str
) -> None:
    own = {each.quantity for each in series if each.machine == machine}
    if not own:
        known = sorted({each.machine for each in series})
        raise UsageError(
            f"{source}: machine", expected=message("one-of", names=known), found=repr(machine)
        )
    if unknown := sorted(set(of) - own):
        raise UsageError(
            f"{source}: machine.{machine!r}",
            expected=message("one-of", names=sorted(own)),
            found=", ".join(unknown),
        )
