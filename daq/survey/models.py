"""The survey file as structs, one per section. The name of a field contains its unit, and the type
its limits.

`daq.survey.template` describes every field. `daq.survey.rules` checks rules about more than one
field.
"""

from collections.abc import Mapping
from dataclasses import fields
from datetime import date
from pathlib import Path
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from stepdiag.base.names import BODY_DIAGONALS
from stepdiag.base.readings import runs
from stepdiag.base.volume import MOST_INCREMENTS, Volume
from stepdiag.daq.formats.expressions import Expression, Kind, parse_expression
from stepdiag.daq.formats.signals import (
    CONTRACT_SIGNALS,
    SIGNAL_NAMES,
    SignalMap,
    SignalSpec,
    describe,
)
from stepdiag.daq.records.events import Table

Positive = Annotated[float, Meta(gt=0)]
NotNegative = Annotated[float, Meta(ge=0)]
Assumed = Annotated[float, Meta(ge=0, le=10_000)]
Stated = Annotated[float, Meta(gt=0, le=10_000)]
"""Types of sizes in um, urad, C or similar units, with limits: no machine has errors above ten
millimetres, and sums of lengths above a hundred metres are not exact.
"""
Fraction = Annotated[float, Meta(ge=0, lt=1)]
Text = Annotated[str, Meta(min_length=1)]
Line = Annotated[
    str,
    Meta(
        max_length=200,
        pattern=r"^[^\x00-\x1f\x7f-\x9f\u2028\u2029]*\Z",
        description="one-line-of-text",
    ),
]
"""A text without line breaks, for a single line of the report."""
Displacement = Literal["EXX", "EYX", "EZX", "EXY", "EYY", "EZY", "EXZ", "EYZ", "EZZ"]
Rotation = Literal["EAX", "EBX", "ECX", "EAY", "EBY", "ECY", "EAZ", "EBZ", "ECZ"]
Port = Annotated[int, Meta(ge=1, le=65535)]
Triple = tuple[float, float, float]
PositiveTriple = tuple[Positive, Positive, Positive]
FileName = Annotated[
    str,
    Meta(
        pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,63}\Z",
        description="name-safe-as-folder",
    ),
]
"""A name that every file system accepts for a folder."""
HostName = Annotated[
    str,
    Meta(
        pattern=r"^[A-Za-z0-9]([A-Za-z0-9.-]{0,251}[A-Za-z0-9])?\Z",
        description="name-of-computer",
    ),
]
BesideFile = Annotated[
    str, Meta(pattern=r"^[^\x00-\x1f\x7f]{1,100}\Z", description="name-of-file")
]


class Identity(msgspec.Struct, frozen=True, kw_only=True):
    name: FileName
    machine: Annotated[Line, Meta(min_length=1)]
    operator: Line = ""
    workpiece: Line = ""
    directory: str = "."
    temperature_note: Line = ""
    event: Line = ""
    archive: Line = ""


AxisOrder = Literal["xyz", "xzy", "yxz", "yzx", "zxy", "zyx"]


class VolumeSection(msgspec.Struct, frozen=True, kw_only=True):
    size_mm: PositiveTriple
    increments: Annotated[int, Meta(ge=1, le=MOST_INCREMENTS)]
    origin_mm: Triple = (0.0, 0.0, 0.0)
    axis_order: AxisOrder = "xyz"


class BeamOffset(msgspec.Struct, frozen=True, kw_only=True):
    setup: Text
    offset_mm: Triple


class Plan(msgspec.Struct, frozen=True, kw_only=True):
    setups: tuple[str, ...] = BODY_DIAGONALS
    return_pass: bool = True
    repeats: Annotated[int, Meta(ge=1, le=100)] = 1
    feed_mm_min: Positive = 2000.0
    dwell_s: Positive = 2.0
    overrun_mm: NotNegative = 5.0
    axis_orders: tuple[AxisOrder, ...] = ()
    alternate_orders: bool = False
    targets: Annotated[int, Meta(ge=0, le=MOST_INCREMENTS)] = 0
    diagonal_setup_min: NotNegative = 30.0
    linear_setup_min: NotNegative = 20.0
    fourdof_setup_min: NotNegative = 25.0
    beam_shift_min: NotNegative = 5.0
    beam_offset: tuple[BeamOffset, ...] = ()
    propose_next: bool = True

    @property
    def offsets_mm(self) -> dict[str, Triple]:
        """Return the offset in mm of each shifted setup from the unshifted setup, by name. Shifted
        setups along the same travel have the names ``ppp+1``, ``ppp+2`` in order.
        """
        named: dict[str, Triple] = {}
        seen: dict[str, int] = {}
        for offset in self.beam_offset:
            seen[offset.setup] = seen.get(offset.setup, 0) + 1
            named[f"{offset.setup}+{seen[offset.setup]}"] = offset.offset_mm
        return named

    @property
    def all_setups(self) -> tuple[str, ...]:
        """Return the setups in the order of driving: a setup with a shifted beam follows the setup
        of the same travel.
        """
        bases = dict.fromkeys((*self.setups, *(offset.setup for offset in self.beam_offset)))
        named = [*self.setups, *self.offsets_mm]
        return tuple(
            name for base in bases for name in named if name.partition("+")[0] == base
        )

    @property
    def passes_per_setup(self) -> int:
        """Return the number of passes of a setup: for each repeat an outward pass and, if
        requested, a return pass.
        """
        return self.repeats * (2 if self.return_pass else 1)


class Machine(msgspec.Struct, frozen=True, kw_only=True):
    chain: Text = "FXYZ"
    expansion_um_m_c: Triple = (11.7, 11.7, 11.7)
    apply_expansion: bool = False
    laser_on: Literal["table", "spindle"] = "table"
    compensation: Literal["off", "on", "?"] | None = None
    """State of the control's compensation. None in a file that is older than this field; ``"?"`` if
    the question is not answered.
    """
    active: tuple[BesideFile, ...] = ()
    active_date: date | None = None
    active_source: str = ""


class SerialSection(msgspec.Struct, frozen=True, kw_only=True):
    port: Text
    baud: Annotated[int, Meta(ge=50, le=4_000_000)] = 115200
    bytesize: Literal[7, 8] = 8
    parity: Literal["N", "E", "O"] = "N"
    stopbits: Literal[1, 2] = 1


class UmdSection(msgspec.Struct, frozen=True, kw_only=True):
    axis: Literal[1, 2, 3] = 1
    phase_bits: Literal[8, 16] | None = None


class LineSection(msgspec.Struct, frozen=True, kw_only=True):
    pattern: Text
    unit: Literal["mm", "um", "nm", "pm", "inch", "counts"] = "mm"
    scale: float = 1.0
    counter_modulus: Annotated[int, Meta(ge=0)] = 65536
    beam_threshold: Fraction = 0.2
    beam_full: Positive = 1.0
    rate_hz: Positive | None = None
    encoding: Literal["ascii", "latin-1"] = "ascii"
    terminator: Literal["\n", "\r"] = "\n"


class FramesSection(msgspec.Struct, frozen=True, kw_only=True):
    sync: Text
    layout: tuple[Text, ...]
    byte_order: Literal["little", "big"] = "little"
    checksum: Text = "none"
    checksum_from: Annotated[int, Meta(ge=0)] = 0
    checksum_order: Literal["little", "big"] | None = None
    unit: Literal["mm", "um", "nm", "pm", "inch", "counts"] = "mm"
    scale: float = 1.0
    beam_threshold: Fraction = 0.2
    beam_full: Positive = 1.0
    lost_bits: Annotated[int, Meta(ge=0)] = 0
    error_bits: Annotated[int, Meta(ge=0)] = 0
    good_bits: Annotated[int, Meta(ge=0)] = 0
    rate_hz: Positive | None = None


class NdSection(msgspec.Struct, frozen=True, kw_only=True):
    value: Literal["current", "displayed"] = "current"
    axis: Annotated[int, Meta(ge=1, le=8)] = 1
    resolution_mm: Positive = 0.0001
    unit: Literal["mm", "inch"] = "mm"
    poll_hz: Annotated[float, Meta(gt=0, le=100)] = 20.0


class Ids3010Section(msgspec.Struct, frozen=True, kw_only=True):
    axis: Literal[1, 2, 3] = 1
    interface: Literal["ids", "sen"] = "ids"
    poll_hz: Annotated[float, Meta(gt=0, le=100)] = 50.0
    contrast_full: Annotated[float, Meta(gt=0, le=1000)] = 1000.0
    beam_threshold: Fraction = 0.2


class LasertexSection(msgspec.Struct, frozen=True, kw_only=True):
    level_full: Annotated[float, Meta(gt=0, le=255)] = 100.0
    beam_threshold: Fraction = 0.2


class QudisSection(msgspec.Struct, frozen=True, kw_only=True):
    axis: Literal[1, 2, 3] = 1
    average: Annotated[int, Meta(ge=0, le=16)] = 5
    absolute: bool = False
    marker: bool = False


class Laser(SerialSection, frozen=True, kw_only=True):
    format: Literal["umd", "nd", "line", "frames", "ids3010", "lasertex", "qudis"]
    sign: Literal[1, -1] = 1
    latency_s: NotNegative = 0.0
    wavelength_nm: Annotated[float, Meta(gt=300, lt=2000)] = 632.991
    optics: Literal[1, 2, 4] = 1
    compensated: bool = False
    dead_path_mm: NotNegative = 0.0
    umd: UmdSection = UmdSection()
    line: LineSection | None = None
    frames: FramesSection | None = None
    nd: NdSection = NdSection()
    ids3010: Ids3010Section = Ids3010Section()
    lasertex: LasertexSection = LasertexSection()
    qudis: QudisSection = QudisSection()


class FourdofSection(msgspec.Struct, frozen=True, kw_only=True):
    encoding: Literal["binary", "ascii"] = "binary"
    rate_hz: Positive | None = None
    full_sum: PositiveTriple | None = None
    beam_threshold: Fraction = 0.2


class TqdSection(msgspec.Struct, frozen=True, kw_only=True):
    poll_hz: Annotated[float, Meta(gt=0, le=200)] = 50.0
    full_sum_v: Annotated[float, Meta(gt=0, le=20)] = 10.0
    beam_threshold: Fraction = 0.2


Turn = Literal["+A", "-A", "+B", "-B", "+C", "-C"]


class AnglesSection(msgspec.Struct, frozen=True, kw_only=True):
    pattern: str = ""
    unit: Literal["arcsec", "urad", "mrad", "deg"] = "arcsec"
    poll_hz: Annotated[float, Meta(gt=0, le=100)] = 10.0
    u_urad: NotNegative = 1.0
    x: tuple[Turn, ...] = ()
    y: tuple[Turn, ...] = ()
    z: tuple[Turn, ...] = ()

    def turns(self, axis: str) -> tuple[Turn, ...]:
        """Return the rotation, with its sign, that each angle reading measures in a run along
        ``axis`` (x, y, z).
        """
        return {"x": self.x, "y": self.y, "z": self.z}[axis]


MachineDirection = Literal["+x", "-x", "+y", "-y", "+z", "-z"]


class HeadRun(msgspec.Struct, frozen=True, kw_only=True):
    beam: MachineDirection
    detector_x: MachineDirection
    detector_y: MachineDirection
    target_on: Literal["tool", "work"] = "tool"
    distance_mm: NotNegative = 300.0


class Head(SerialSection, frozen=True, kw_only=True):
    format: Literal["fourdof", "tqd", "elcomat", "wyler"]
    id: str = ""
    calibration: str = ""
    distance: Literal["commanded", "laser"] = "commanded"
    latency_s: NotNegative = 0.0
    x: HeadRun = HeadRun(beam="+x", detector_x="+y", detector_y="+z")
    y: HeadRun = HeadRun(beam="+y", detector_x="-x", detector_y="+z")
    z: HeadRun = HeadRun(beam="+z", detector_x="+x", detector_y="+y")
    fourdof: FourdofSection = FourdofSection()
    tqd: TqdSection = TqdSection()
    angles: AnglesSection = AnglesSection()

    @property
    def angular(self) -> bool:
        """Return whether the head is an autocollimator or a level, which measures rotations without
        a calibration file.
        """
        return self.format in ("elcomat", "wyler")

    def run_along(self, axis: str) -> HeadRun:
        return {"x": self.x, "y": self.y, "z": self.z}[axis]


_PORTS = {"tcp": 502, "s7": 102, "lsv2": 19000}


class Handshake(msgspec.Struct, frozen=True, kw_only=True):
    enabled: bool = False
    table: Table = "holding"
    address: Annotated[int, Meta(ge=0, le=65535)] = 100


class Plc(msgspec.Struct, frozen=True, kw_only=True):
    transport: Literal["tcp", "rtu", "s7", "lsv2", "none"] = "tcp"
    host: Text = "127.0.0.1"
    port: Port | None = None
    serial_port: str = ""
    baud: Annotated[int, Meta(ge=300, le=4_000_000)] = 19200
    parity: Literal["N", "E", "O"] = "E"
    stopbits: Literal[1, 2] = 1
    unit: Annotated[int, Meta(ge=0, le=255)] = 1
    rack: Annotated[int, Meta(ge=0, le=7)] = 0
    slot: Annotated[int, Meta(ge=0, le=31)] = 2
    poll_hz: Positive = 50.0
    timeout_s: Positive = 0.3
    latency_s: NotNegative = 0.0
    own_signals: dict[str, SignalSpec] = msgspec.field(name="signals", default_factory=dict)
    inputs: dict[str, SignalSpec] = {}
    expressions: dict[str, Text] = {}
    handshake: Handshake = Handshake()

    @property
    def silent(self) -> bool:
        """Return whether the machine has no signals. The operator then begins each pass, and the
        laser's plateaus identify the stops.
        """
        return self.transport == "none"

    @property
    def tcp_port(self) -> int:
        """Return the TCP port of the control, from the file or the usual port of the protocol."""
        return self.port or _PORTS.get(self.transport, 502)

    @property
    def signals(self) -> SignalMap:
        """Return the values to read from the machine: the signals and inputs of the file, or the
        contract's block for a Modbus control without signals in the file.
        """
        if self.silent:
            return {}
        return {**self.own_signals, **self.inputs} or (
            {} if self.transport in ("s7", "lsv2") else CONTRACT_SIGNALS
        )

    @property
    def signal_names(self) -> tuple[str, ...]:
        """Return the names of the machine's signals, read directly or computed by an expression, in
        the order of the contract's block.
        """
        return tuple(
            name
            for name in SIGNAL_NAMES
            if name in self.expressions or (name in self.signals and name not in self.inputs)
        )

    def parsed(self, source: str = "survey") -> Mapping[str, Expression]:
        return {name: self.expression(name, source) for name in self.expressions}

    def expression(self, name: str, source: str) -> Expression:
        """Return the expression of a signal. Raises UsageError with the place of the first wrong
        character.
        """
        kinds: dict[str, Kind] = {
            each: "bit" if spec.type == "bit" else "word"
            for each, spec in self.inputs.items()
        }
        return parse_expression(
            self.expressions[name], kinds, f"{source}: plc.expressions.{name}"
        )

    def place(self, name: str) -> str:
        """Return the source of a signal as text: ``holding 2 bit 0``, or its expression."""
        return (
            self.expressions[name]
            if name in self.expressions
            else describe(self.signals[name])
        )

    @property
    def standing(self) -> frozenset[str]:
        """Return the names of the values that show whether the machine stands."""
        return (
            self.parsed()["stopped"].names
            if "stopped" in self.expressions
            else frozenset(["stopped"])
        )


class StopRules(msgspec.Struct, frozen=True, kw_only=True):
    settle_s: NotNegative = 0.2
    min_window_s: Positive = 0.3
    max_slope_um_s: Positive = 1.0
    max_scatter_um: Positive = 2.0


class AirSensor(SerialSection, frozen=True, kw_only=True):
    format: Literal["ptu300", "line"] = "line"
    pattern: str = ""
    temperature_unit: Literal["C", "F", "K"] = "C"
    pressure_unit: Literal["hPa", "mbar", "kPa", "Pa", "bar", "mmHg", "inHg"] = "hPa"
    request: str = ""
    greeting: str = ""
    poll_s: Annotated[float, Meta(ge=0.1, le=5)] = 2.0
    terminator: Literal["\n", "\r"] = "\n"


class Environment(msgspec.Struct, frozen=True, kw_only=True):
    source: Literal["plc", "laser", "sensor", "fixed"] = "plc"
    sensor: AirSensor | None = None
    air_temperature_c: Annotated[float, Meta(ge=-20, le=60)] = 20.0
    air_pressure_hpa: Annotated[float, Meta(ge=500, le=1200)] = 1013.25
    relative_humidity_percent: Annotated[float, Meta(ge=0, le=100)] = 50.0
    material_temperature_c: Annotated[float, Meta(ge=-20, le=60)] = 20.0


class Solver(msgspec.Struct, frozen=True, kw_only=True):
    method: Literal["estimate", "least-squares", "wang2000"] = "estimate"
    angles: str = ""


class Uncertainty(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The user's assumptions with k = 1, except ranges and limits;
    `stepdiag.base.conditions.assumptions` describes each of them.

    If the size of an error of the machine is None, the usual value for ``machine_class`` and
    ``feedback`` is used.
    """

    machine_class: Literal["good", "ordinary", "poor"] = "ordinary"
    feedback: Literal["screw", "scale"] = "screw"
    pitch_mm: Stated | None = None
    """Pitch of the screws in mm; None if the file contains no pitch."""
    angles_urad: Assumed | None = None
    drift_um: Assumed | None = None
    wander_um: Assumed | None = None
    repeatability_um: Assumed | None = None
    setup_c: Assumed | None = None
    growth_um_m: Assumed | None = None
    between_um: Assumed | None = None
    shape_um: Stated | None = None
    squareness_urad: Stated | None = None
    scale_um_m: Stated | None = None
    index_ppm: Assumed = 0.2
    u_air_temperature_c: Assumed = 0.0
    u_air_pressure_hpa: Assumed = 0.0
    u_relative_humidity_percent: Assumed = 0.0
    u_laser_ppm: Assumed = 0.0
    index_setup_ppm: Assumed = 0.1
    u_material_c: Assumed = 0.3
    u_expansion_um_m_c: Assumed = 1.0
    alignment_mrad: Assumed = 0.5
    reading_um: Stated = 0.3
    source_shift_um: Assumed = 1.0


class Tolerance(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The largest allowed errors; None or a missing entry means no limit.
    `stepdiag.base.conformity` describes each of them.
    """

    volumetric_rms_um: Stated | None = None
    volumetric_largest_um: Stated | None = None
    squareness_urad: Stated | None = None
    positioning_e_um: Stated | None = None
    positioning_a_um: Stated | None = None
    functions_um: dict[Displacement, Stated] = {}
    functions_urad: dict[Rotation, Stated] = {}

    def by_quantity(self) -> dict[str, float]:
        """Return the tolerances by quantity; error functions have their symbols as names."""
        single = {
            name: value
            for name, value in msgspec.structs.asdict(self).items()
            if isinstance(value, float)
        }
        return {
            **single,
            **{
                str(name): value
                for part in (self.functions_um, self.functions_urad)
                for name, value in part.items()
            },
        }


class Export(msgspec.Struct, frozen=True, kw_only=True):
    controller: FileName
    """Name of the control, and of the folder of its files."""
    profile: Text


class Proof(msgspec.Struct, frozen=True, kw_only=True):
    """The export that a proof run tests: control, result, readings and profile. `Machine.active`
    lists the loaded files. ``profile`` is empty if the export used no profile.
    """

    controller: FileName
    result: Text
    readings: Text
    profile: str = ""


class Page(msgspec.Struct, frozen=True, kw_only=True):
    enabled: bool = True
    host: Text = "127.0.0.1"
    port: Port = 8420
    token: str = ""
    """Access token of the operator's page; only logs of older versions contain a token. A survey
    file with a token is refused, because every log would contain the token.
    """
    token_file: str = ""
    names: tuple[HostName, ...] = ()
    certificate: str = ""
    key: str = ""
    language: Literal["en", "de"] = "en"


class Certificate(msgspec.Struct, frozen=True, kw_only=True):
    """Customer, machine and instruments for the first page of the report, which shows "not stated"
    for an empty entry.
    """

    customer: str = ""
    machine_serial: str = ""
    instrument: str = ""
    instrument_serial: str = ""
    instrument_certificate: str = ""
    sensors: str = ""


class Recording(msgspec.Struct, frozen=True, kw_only=True):
    max_gb: NotNegative = 0.0
    min_free_gb: NotNegative = 1.0


class Metrics(msgspec.Struct, frozen=True, kw_only=True):
    enabled: bool = False
    host: Text = "127.0.0.1"
    port: Port = 9420


class Survey(msgspec.Struct, frozen=True, kw_only=True):
    """The whole survey file. The field ``identity`` is the section ``[survey]``, ``box`` is
    ``[volume]``, ``exports`` is ``[[export]]``.
    """

    identity: Identity = msgspec.field(name="survey")
    box: VolumeSection = msgspec.field(name="volume")
    laser: Laser
    plan: Plan = Plan()
    machine: Machine = Machine()
    head: Head | None = None
    plc: Plc = Plc()
    stop: StopRules = StopRules()
    environment: Environment = Environment()
    solver: Solver = Solver()
    uncertainty: Uncertainty = Uncertainty()
    tolerance: Tolerance = Tolerance()
    exports: tuple[Export, ...] = msgspec.field(name="export", default=())
    proof: Proof | None = None
    report: Certificate = Certificate()
    page: Page = Page()
    metrics: Metrics = Metrics()
    recording: Recording = Recording()

    @property
    def volume(self) -> Volume:
        return Volume(
            origin_mm=self.box.origin_mm,
            size_mm=self.box.size_mm,
            increments=self.box.increments,
        )

    @property
    def air_sensor(self) -> AirSensor | None:
        return self.environment.sensor if self.environment.source == "sensor" else None

    @property
    def planned(self) -> runs.Plan:
        """Return the plan in the form for planner, NC programs and recording."""
        plan, offsets = self.plan, self.plan.offsets_mm
        return runs.Plan(
            volume=self.volume,
            runs=tuple(
                runs.Run(
                    setup=name,
                    repeats=plan.repeats,
                    return_pass=plan.return_pass,
                    beam_offset_mm=offsets.get(name, (0.0, 0.0, 0.0)),
                    axis_orders=plan.axis_orders,
                    alternate=plan.alternate_orders,
                    targets=plan.targets,
                )
                for name in plan.all_setups
            ),
            axis_order=self.axis_order,
            pace=runs.Pace(
                **{each.name: getattr(plan, each.name) for each in fields(runs.Pace)}
            ),
        )

    @property
    def axis_order(self) -> str:
        return self.box.axis_order

    def folder(self, survey_file: Path) -> Path:
        """Return the folder of the survey's logs and results: ``<directory>/<name>``, relative to
        the survey file.
        """
        return survey_file.parent / self.identity.directory / self.identity.name
