"""The members of a result besides its error functions."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from importlib.metadata import version
from typing import Annotated, Literal, Self

from stepdiag.base.messages import Place, Words, where
from stepdiag.base.result.typed import BESIDE, OPTIONAL, Maybe, Named
from stepdiag.base.setups import Kind
from stepdiag.base.volume import Vector

Axis = Literal["X", "Y", "Z"]
Lengths = Literal["as_measured", "at_20_c"]
OptionalText = Annotated[str, OPTIONAL]
Verdict = Literal["conform", "not_conform", "not_decidable"]
"""Verdict by ISO 14253-1 about a value or a machine."""
Range = tuple[float, float]
"""Least and largest value of a sensor."""
Triple = tuple[float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Software:
    """Name and version of the program that wrote a result, empty if unknown."""

    name: str = ""
    version: str = ""


def software() -> Software:
    """Return name and version of this program."""
    return Software(name="stepdiag", version=version("stepdiag"))


@dataclass(frozen=True, slots=True, kw_only=True)
class ActiveFile:
    """A file that was active in the control: its name, its hash, and when and how it was read
    out."""

    name: str
    sha256: str
    date: str
    source: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Source:
    """A source of the result: its role, its name, and its SHA-256. The SHA-256 of a log is that of
    its records, so packing does not change it.

    ``role`` is log, readings, angles, straightness, uncertainty, tolerance, run or environment. A
    damaged log has no hash.
    """

    role: str
    name: str
    sha256: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Facts:
    """The facts of the measurement: operator, object, time and instruments; a missing text is
    empty.

    ``compensation`` is None if the survey does not answer whether a compensation was active;
    ``active_files`` are the files of an active compensation.
    """

    machine: str = ""
    survey: str = ""
    operator: str = ""
    workpiece: str = ""
    date: str = ""
    begun: OptionalText = ""
    ended: OptionalText = ""
    temperature_note: OptionalText = ""
    event: OptionalText = ""
    corrected: OptionalText = ""
    customer: OptionalText = ""
    machine_serial: OptionalText = ""
    instrument: OptionalText = ""
    instrument_serial: OptionalText = ""
    instrument_certificate: OptionalText = ""
    sensors: OptionalText = ""
    wavelength_nm: Maybe[float] = None
    at_20_c: bool = False
    compensation: Literal["off", "on"] | None = None
    active_files: tuple[ActiveFile, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class AssumedConditions:
    """Conditions that no sensor measured and no person entered, with their default values in the
    survey file."""

    air_temperature_c: Maybe[float] = None
    air_pressure_hpa: Maybe[float] = None
    relative_humidity_percent: Maybe[float] = None
    material_temperature_c: Maybe[float] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Conditions:
    """Least and largest value of each sensor of air and material over the used stops."""

    air_temperature_c: Maybe[Range] = None
    air_pressure_hpa: Maybe[Range] = None
    relative_humidity_percent: Maybe[Range] = None
    material_temperature_c: Maybe[Range] = None
    assumed: Maybe[AssumedConditions] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Judged:
    """A value and its tolerance (`base.conformity`): ends of its coverage interval (k = 2),
    probability of conformity, verdict.

    ``tolerance`` limits the magnitude. An unidentified value is None and not decidable.
    """

    quantity: str
    unit: Literal["um", "urad"]
    tolerance: float
    value: float | None
    low: float | None
    high: float | None
    probability: float | None
    verdict: Verdict


@dataclass(frozen=True, slots=True, kw_only=True)
class Conformity:
    """The verdicts about every value with a tolerance as found, and about the volumetric values
    predicted after an ideal compensation."""

    as_found: tuple[Judged, ...]
    predicted: tuple[Judged, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Fit:
    """Fit of the readings to the model. The closed forms give the standard uncertainty of a reading
    (``noise_um``)."""

    readings: int | None = None
    used: int | None = None
    rank: int | None = None
    unknowns: int | None = None
    degrees_of_freedom: int | None = None
    chi_square: float | None = None
    noise_um: Maybe[float] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Length:
    """A length in um with its combined standard uncertainty; results of the closed forms have no
    u."""

    value: float
    u: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Backlash:
    """Mean backlash of an axis (approach in + minus approach in -) with its combined standard
    uncertainty."""

    value: float
    u: float
    unit: Literal["um"] = "um"


@dataclass(frozen=True, slots=True, kw_only=True)
class Backlashes:
    """Mean backlash by axis, None for an axis whose backlash the data do not identify."""

    X: Maybe[Backlash] = None
    Y: Maybe[Backlash] = None
    Z: Maybe[Backlash] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class LengthScale:
    """Scale of an axis at one temperature with its combined standard uncertainty; both are None if
    the data do not identify the scale."""

    value: float | None
    u: float | None
    unit: Literal["um/m"] = "um/m"


@dataclass(frozen=True, slots=True, kw_only=True)
class LengthsReport:
    """The kind of lengths that the tables correct (as measured, or at 20 C), and the scales for
    both kinds of lengths. ``material_c`` is the temperature of each axis, None without a
    measurement."""

    tables: Lengths
    material_c: Triple | None
    expansion_um_m_c: Triple | None
    as_measured: dict[Axis, LengthScale] | None
    at_20_c: dict[Axis, LengthScale] | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Tool:
    """The point of the tool for which the errors are valid, and the largest effect of angles (k =
    2) at a distance of 100 mm from this point."""

    offset_mm: Triple | None
    up_to_um_per_100_mm: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class UnseenSlip:
    """A slip of the laser's count in um. ``half_um`` is the size that half of all surveys detect,
    ``nearly_um`` the size that 95 % detect. ``volume_um`` is the effect of a slip of ``half_um`` on
    the volume (rms). A value is None if a slip of any size is undetected.

    ``readings_um`` is the effect of the noise of the readings on the volume (k = 1). ``passes`` are
    the passes in which a slip of ``half_um`` has a larger effect.
    """

    setup: str
    pass_number: Annotated[int, Named("pass")]
    stop: int
    half_um: float | None
    nearly_um: float | None
    volume_um: float | None
    readings_um: float | None = None
    passes: tuple[str, ...] = ()

    @property
    def where(self) -> Words:
        """Return the place of the slip as a message: the move before a stop of a pass."""
        return where(Place(setup=self.setup, pass_number=self.pass_number, stop=self.stop))


@dataclass(frozen=True, slots=True, kw_only=True)
class UnseenSlips:
    """The most harmful undetected slip in diagonals and in runs along an axis, None without runs of
    this kind."""

    diagonals: Maybe[UnseenSlip] = None
    runs: Maybe[UnseenSlip] = None

    def __iter__(self) -> Iterator[UnseenSlip]:
        return (one for one in (self.diagonals, self.runs) if one is not None)


@dataclass(frozen=True, slots=True, kw_only=True)
class Closure:
    """The closure residual ppp - npp - pnp - ppn by axis at each node, in um."""

    x: tuple[float, ...]
    y: tuple[float, ...]
    z: tuple[float, ...]

    @classmethod
    def of(cls, by_axis_um: Vector) -> Self:
        """Return the closure residual from its rows, shape (3, nodes)."""
        x, y, z = by_axis_um.tolist()
        return cls(x=tuple(x), y=tuple(y), z=tuple(z))


@dataclass(frozen=True, slots=True, kw_only=True)
class Assumed:
    """The assumed sizes behind U (`solver.model.assumptions.Assumptions`). Relative sizes are in
    ppm. A size is None if the result does not contain it."""

    angles_urad: float | None = None
    angle_urad: dict[str, float] | None = None
    drift_um: float | None = None
    wander_um: float | None = None
    repeatability_um: float | None = None
    setup_c: float | None = None
    growth_um_m: float | None = None
    expansion_um_m_c: Triple | None = None
    u_expansion_um_m_c: float | None = None
    index_ppm: float | None = None
    index_setup_ppm: float | None = None
    alignment_mrad: float | None = None
    between_um: float | None = None
    reading_um: float | None = None
    material_c: Triple | None = None
    u_material_c: float | None = None
    material_stated: bool | None = None
    reduced_to_20_c: bool | None = None
    shape_um: float | None = None
    squareness_urad: float | None = None
    scale_um_m: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Difference:
    """The straightness measured by the head minus the straightness from the diagonals, both
    relative to their end-point lines, in um."""

    position_mm: tuple[float, ...]
    value: tuple[float, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadStraightness:
    """A straightness measured by the 4-DOF head, for each of its reference lines. If ``misclosure``
    is above 1, the head and the diagonals contradict each other."""

    passes: int
    end_point_um: float
    least_squares_um: float
    minimum_zone_um: float
    u_um: float
    residual_um: float
    misclosure: float | None
    sign_hidden: Annotated[bool, OPTIONAL] = False
    used: Annotated[bool, OPTIONAL] = True
    difference_um: Maybe[Difference] = None


VOLUME = "volume"
"""Name of the error vector over the volume in the uncertainty budget."""
READINGS, BETWEEN_TARGETS, NOT_MEASURED = "readings", "between the targets", "not measured"
"""Sources of the uncertainty budget that do not come from the adjustment."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Budget:
    """The uncertainty budget (k = 1): assumptions by source, contributions by quantity and source,
    combined uncertainty by quantity."""

    assumptions: dict[str, Words]
    shares: dict[str, dict[str, float]]
    combined: dict[str, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class CoverageFactor:
    """Effective degrees of freedom of an uncertainty, and its coverage factor for 95 %."""

    degrees_of_freedom: float
    k: float


@dataclass(frozen=True, slots=True, kw_only=True)
class StandardFigures:
    """The values of a standard for a setup or a set of diagonals (``_d``), in um. The fields have
    the symbols of the standard.

    A value is None if the runs do not determine it or the standard does not define it. ``U``
    contains expanded uncertainties (k = 2) by value.
    """

    standard: str
    source_status: str
    E_up: Maybe[float] = None
    E_down: Maybe[float] = None
    E: Maybe[float] = None
    M: Maybe[float] = None
    B: Maybe[float] = None
    B_mean: Maybe[float] = None
    R_up: Maybe[float] = None
    R_down: Maybe[float] = None
    R: Maybe[float] = None
    A_up: Maybe[float] = None
    A_down: Maybe[float] = None
    A: Maybe[float] = None
    E_d: Maybe[float] = None
    B_d: Maybe[float] = None
    R_d: Maybe[float] = None
    A_d: Maybe[float] = None
    P: Maybe[float] = None
    Pa: Maybe[float] = None
    U_max: Maybe[float] = None
    U_mean: Maybe[float] = None
    Ps_max: Maybe[float] = None
    Ps_mean: Maybe[float] = None
    runs: Maybe[int] = None
    lengths: Maybe[Literal["as measured", "at 20 C"]] = None
    U: Maybe[dict[str, float]] = None
    U_status: OptionalText = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Drawn:
    """Standard deviation of a quantity over drawn surveys, for comparison with its u; for a single
    number also the shortest 95 % interval."""

    u: float
    u_stated: float
    low: Maybe[float] = None
    high: Maybe[float] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class MonteCarlo:
    """Number of drawn surveys (JCGM 101), and the scatter of each function or number over these
    surveys."""

    trials: int
    quantities: Annotated[dict[str, Drawn], BESIDE]


@dataclass(frozen=True, slots=True, kw_only=True)
class Drift:
    """Drift of the laser's count over an outward pass and its return pass, with its standard
    uncertainty."""

    pair: int
    rate: float
    unit: Literal["um/h", "um/stop"]
    total_um: float
    u_um: float


@dataclass(frozen=True, slots=True, kw_only=True)
class SetupReport:
    """The travel and the numbers of passes of a setup; also its mirror tilt, drift and scatter if
    known."""

    kind: Kind | None = None
    passes: tuple[int, ...] = ()
    stops: int | None = None
    tilt_mrad: float | None = None
    tilt_xyz_mrad: Triple | None = None
    drift: tuple[Drift, ...] = ()
    repeatability_um: float | None = None
    residual_um: float | None = None
    noise_um: float | None = None
    redundancy: float | None = None


def triple(values: Iterable[float]) -> Triple:
    x, y, z = (float(value) for value in values)
    return x, y, z
