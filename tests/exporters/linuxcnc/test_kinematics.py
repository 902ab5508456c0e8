"""The kinematics component: built from what the export writes, it moves the joints as the lattice
says and refuses what is not whole.

The component is compiled with LinuxCNC's own headers and loaded into this process; ``halstub.c``
stands in for HAL. What the real control does with it is in ``tests/system/control``.
"""

import ctypes
import hashlib
import itertools
import math
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import HealthCheck, given
from hypothesis import strategies as st

from stepdiag.base.errors import SafetyError, UsageError
from stepdiag.exporters.export.export import export
from stepdiag.exporters.export.written import ExportReport
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.sets import read_given
from stepdiag.exporters.linuxcnc import kinematics
from stepdiag.exporters.profiles.file import parse_profile
from stepdiag.exporters.profiles.registry import controller_named
from stepdiag.exporters.safety.verify import verify_files
from stepdiag.exporters.tables import lattice
from stepdiag.exporters.tables.profile import Profile
from testkit.exact.machines import profile_text
from testkit.exact.results import VOLUME, made_result
from testkit.examples import few

RESULT = made_result(
    {"EXX": [0, 3, 8, 12, 20], "EYX": [0, 1.5, 2, 1, 0]},
    squareness={"C0Y": 20.0, "B0Z": 8.0, "A0Z": -15.0},
    angles={
        "EAX": [0, 8, 20, 4, -10],
        "EBX": [0, -3, -6, 3, 9],
        "ECY": [0, 10, 14, 4, 2],
        "EAY": [0, 5, -9, 4, 12],
    },
)
HEADERS = Path("/usr/include/linuxcnc")
BUILT = itertools.count()

pytestmark = pytest.mark.usefixtures("debian")


def profile(
    more: str = "",
    joints: str = "{ X = [0], Y = [1], Z = [2] }",
    units: str = "mm",
    files: dict[str, bytes] | None = None,
) -> Profile:
    text = profile_text(
        "linuxcnc",
        steps_mm=(50.0, 50.0, 50.0),
        references_mm=(-200.0, 0.0, -100.0),
        direction="mean",
    )
    text = text.replace(
        "joints = { X = [0], Y = [1], Z = [2] }", f'joints = {joints}\nway = "kinematics"'
    )
    text = text.replace(
        'measured_with = "off"', f'measured_with = "off"\nunits = "{units}"\n{more}'
    )
    return parse_profile(
        text, "linuxcnc.toml", controller_named("linuxcnc"), VOLUME, files or {}
    )


def written(folder: Path, of: Profile | None = None) -> ExportReport:
    return export(RESULT, "linuxcnc", of or profile(), out_dir=folder)


class Kins:
    """The component in this process. It is loaded from a copy of its own each time: a library is
    loaded once only."""

    def __init__(self, folder: Path, library: Path) -> None:
        own = folder / f"kins{next(BUILT)}.so"
        shutil.copy(library, own)
        self._held: list[bytes] = []
        self._library = ctypes.CDLL(str(own))
        self._library.stub_step.argtypes = [ctypes.c_int, ctypes.c_double, ctypes.c_long]

    def load(
        self, path: Path, vertices: int, letters: str = "XYZ", *, inch: bool = False
    ) -> int:
        """Load the component with these parameters; 0 where it takes them."""
        addresses = [
            ctypes.c_void_p.in_dll(self._library, f"rtapi_info_address_{name}")
            for name in ("coordinates", "lattice", "vertices", "inch")
        ]
        self._held = [letters.encode(), str(path).encode()]
        self._library.stub_set(*addresses, self._held[0], self._held[1], vertices, int(inch))
        return int(self._library.rtapi_app_main())

    def step(self, on: bool, slew: float, period_ns: int) -> float:
        """Let a servo cycle pass; return the weight of the compensation."""
        self._library.stub_step(int(on), slew, period_ns)
        return ctypes.c_double.from_address(
            ctypes.c_void_p.in_dll(self._library, "stub_weight").value or 0
        ).value

    def inverse(self, world: list[float], joints: int = 3) -> np.ndarray:
        pose, out = (ctypes.c_double * 9)(*world), (ctypes.c_double * 16)()
        flags = ctypes.c_ulong(0)
        assert (
            self._library.kinematicsInverse(
                pose, out, ctypes.byref(flags), ctypes.byref(flags)
            )
            == 0
        )
        return np.array(out[:joints])

    def forward(self, joints: np.ndarray) -> np.ndarray:
        pose, given = (ctypes.c_double * 9)(), (ctypes.c_double * 16)(*joints)
        flags = ctypes.c_ulong(0)
        assert (
            self._library.kinematicsForward(
                given, pose, ctypes.byref(flags), ctypes.byref(flags)
            )
            == 0
        )
        return np.array(pose)

    def cost(self, does: Callable[[], object]) -> int:
        """Return how many stretches of straight code the component runs through meanwhile (of one
        built with ``cyclecount.c``)."""
        stretches = ctypes.c_long.in_dll(self._library, "stretches")
        stretches.value = 0
        does()
        return stretches.value


OWN_FLAGS = (
    "-Wall",
    "-Wextra",
    "-Werror",
    "-Wno-unused-parameter",
    "-std=gnu11",
    "-O1",
    "-fPIC",
)
LINUXCNC_FLAGS = (
    "-DRTAPI",
    "-DUSPACE",
    "-D_GNU_SOURCE",
    "-D__MODULE__",
    f"-isystem{HEADERS}",
)
MOST_STACK = 1024
"""Bytes that one function of the component may take of the stack."""


def compiled(folder: Path, *more: str, counter: str | None = None) -> Path:
    """Return the component, compiled as strictly as the compiler can; ``more`` flags are not for
    what stands beside it."""
    assert HEADERS.is_dir(), (
        "the headers of LinuxCNC are missing: tools/debian linuxcnc-uspace-dev"
    )
    source, own, built = (
        Path(kinematics.__file__).with_name(kinematics.SOURCE),
        folder / "component.o",
        folder / "kins.so",
    )
    beside = [Path(__file__).with_name(name) for name in ("halstub.c", counter) if name]
    subprocess.run(
        [
            "gcc",
            *OWN_FLAGS,
            *LINUXCNC_FLAGS,
            *more,
            f"-Wstack-usage={MOST_STACK}",
            "-c",
            source,
            "-o",
            own,
        ],
        check=True,
    )
    subprocess.run(
        ["gcc", *OWN_FLAGS, *LINUXCNC_FLAGS, "-shared", own, *beside, "-lm", "-o", built],
        check=True,
    )
    return built


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return compiled(tmp_path_factory.mktemp("kins"))


@pytest.fixture
def kins(tmp_path: Path, library: Path) -> Kins:
    return Kins(tmp_path, library)


@pytest.fixture(scope="module")
def loaded(
    tmp_path_factory: pytest.TempPathFactory, library: Path
) -> tuple[Kins, lattice.Lattice]:
    """Return the component with the lattice of an export, switched on, and the lattice as we read
    it."""
    folder = tmp_path_factory.mktemp("loaded")
    written(folder)
    held = lattice.parse(read_given([folder / "lattice.csv"])[0])
    component = Kins(folder, library)
    assert component.load(folder / "lattice.csv", held.vectors_um[..., 0].size) == 0
    assert component.step(True, 1e9, 1_000_000_000) == 1.0
    return component, held


far = st.floats(-400.0, 500.0)


class TestComponent:
    @few(60, suppress_health_check=[HealthCheck.function_scoped_fixture])
    @given(point=st.tuples(far, far, far))
    def test_moves_the_joints_as_the_lattice_says(
        self, loaded: tuple[Kins, lattice.Lattice], point: tuple[float, float, float]
    ) -> None:
        """Inside and outside: joint = command + lattice, and back again, to a picometre."""
        component, held = loaded
        moved = (component.inverse([*point, 0, 0, 0, 0, 0, 0]) - point) * 1e3
        np.testing.assert_allclose(
            moved, held.correction_um(np.array([point]))[0], rtol=0, atol=1e-6
        )
        np.testing.assert_allclose(
            component.forward(component.inverse([*point, 0, 0, 0, 0, 0, 0]))[:3],
            point,
            rtol=0,
            atol=1e-9,
        )

    @pytest.mark.parametrize("strange", [math.nan, math.inf, -math.inf, 1e308])
    def test_a_position_that_is_no_number_stays_in_the_lattice(
        self, loaded: tuple[Kins, lattice.Lattice], strange: float
    ) -> None:
        component, _ = loaded
        moved = component.inverse([strange, 10.0, 10.0, 0, 0, 0, 0, 0, 0])[1:] - 10.0
        assert np.all(np.abs(moved) < 0.1)
        component.forward(np.array([strange, 10.0, 10.0]))

    def test_is_off_until_it_is_switched_on_and_comes_slowly(
        self, kins: Kins, tmp_path: Path
    ) -> None:
        """No joint moves faster than the slew limit, in or out; without the function in the thread
        nothing is corrected at all."""
        written(tmp_path / "out")
        held = lattice.parse(read_given([tmp_path / "out" / "lattice.csv"])[0])
        assert kins.load(tmp_path / "out" / "lattice.csv", held.vectors_um[..., 0].size) == 0
        place = [200.0, 400.0, 100.0, 0, 0, 0, 0, 0, 0]
        assert np.array_equal(kins.inverse(place), place[:3])
        slew, period_s = 50.0, 0.001
        for on, end in ((True, 1.0), (False, 0.0)):
            weights, before = [], kins.inverse(place)
            while not weights or weights[-1] != end:
                weights.append(kins.step(on, slew, 1_000_000))
                now = kins.inverse(place)
                assert np.max(np.abs(now - before)) * 1e3 <= slew * period_s * 1.001
                before = now
                assert len(weights) < 5000
        assert np.array_equal(kins.inverse(place), place[:3])

    def test_gantries_and_other_axes_keep_their_joints(
        self, kins: Kins, tmp_path: Path
    ) -> None:
        written(tmp_path / "out")
        held = lattice.parse(read_given([tmp_path / "out" / "lattice.csv"])[0])
        assert (
            kins.load(tmp_path / "out" / "lattice.csv", held.vectors_um[..., 0].size, "XYYZA")
            == 0
        )
        kins.step(True, 1e9, 1_000_000_000)
        x, y1, y2, z, a = kins.inverse([10.0, 20.0, 30.0, 45.0, 0, 0, 0, 0, 0], joints=5)
        moved = held.correction_um(np.array([[10.0, 20.0, 30.0]]))[0] * 1e-3
        np.testing.assert_allclose(
            [x - 10, y1 - 20, y2 - 20, z - 30, a - 45],
            [*moved[[0, 1, 1, 2]], 0.0],
            rtol=0,
            atol=1e-9,
        )
        np.testing.assert_allclose(
            kins.forward(np.array([x, y1, y2, z, a]))[:4],
            [10.0, 20.0, 30.0, 45.0],
            rtol=0,
            atol=1e-9,
        )

    def test_an_inch_machine_gets_the_same_movement(self, kins: Kins, tmp_path: Path) -> None:
        written(tmp_path / "out", profile(units="inch"))
        assert b"inch=1" in (tmp_path / "out" / "ini_lines.txt").read_bytes()
        held = lattice.parse(read_given([tmp_path / "out" / "lattice.csv"])[0])
        assert (
            kins.load(
                tmp_path / "out" / "lattice.csv", held.vectors_um[..., 0].size, inch=True
            )
            == 0
        )
        kins.step(True, 1e9, 1_000_000_000)
        moved_um = (kins.inverse([1.0, 2.0, 3.0, 0, 0, 0, 0, 0, 0]) - [1.0, 2.0, 3.0]) * 25400
        np.testing.assert_allclose(
            moved_um, held.correction_um(np.array([[25.4, 50.8, 76.2]]))[0], rtol=0, atol=1e-6
        )


def restless(path: Path, counts: tuple[int, int, int]) -> int:
    """Write a lattice over one cubic millimetre whose forward solution goes back and forth for
    ever; return its number of rows.

    It holds from -1000 µm to 1000 µm, a straight line, so the field is the same however many
    vertices it has.
    """
    rows = itertools.product(*(np.linspace(0.0, 1.0, count) for count in counts))
    lines = [
        ",".join(f"{value:.9f}" for value in (*row, *(2000.0 * at - 1000.0 for at in row)))
        for row in rows
    ]
    path.write_text(
        "\n".join(["x_mm,y_mm,z_mm,cx_um,cy_um,cz_um", *lines]) + "\n", encoding="ascii"
    )
    return len(lines)


Costs = list[tuple[int, int, int]]
"""What inverse, forward and update cost, by place, in stretches of straight code."""


def costs_of(folder: Path, built: Path, counts: tuple[int, int, int]) -> tuple[int, Costs]:
    """Return the number of vertices and what a cycle costs, at places within the lattice, beside
    it, and nowhere."""
    rows, component = restless(folder / "restless.csv", counts), Kins(folder, built)
    assert component.load(folder / "restless.csv", rows) == 0
    assert component.step(True, 1e9, 1_000_000_000) == 1.0
    found = [
        (
            component.cost(partial(component.inverse, [*place, 0, 0, 0, 0, 0, 0])),
            component.cost(partial(component.forward, np.array(place))),
            component.cost(partial(component.step, True, 100.0, 1_000_000)),
        )
        for place in itertools.product([-0.7, 0.3, 0.45, 1.3, math.nan, 1e308], repeat=3)
    ]
    return rows, found


@pytest.fixture(scope="module")
def costs(tmp_path_factory: pytest.TempPathFactory) -> dict[int, Costs]:
    """Return the costs by the number of vertices."""
    folder = tmp_path_factory.mktemp("counted")
    built = compiled(folder, "-fsanitize-coverage=trace-pc", counter="cyclecount.c")
    return dict(costs_of(folder, built, counts) for counts in ((2, 2, 2), (64, 32, 32)))


class TestCycle:
    """What a servo cycle costs does not depend on the lattice, nor on what it holds."""

    def test_the_largest_lattice_costs_what_the_smallest_does(
        self, costs: dict[int, Costs]
    ) -> None:
        assert sorted(costs) == [8, kinematics.MOST_VERTICES]
        assert costs[8] == costs[kinematics.MOST_VERTICES]

    def test_a_forward_solution_that_never_settles_ends_after_its_rounds(
        self, costs: dict[int, Costs]
    ) -> None:
        inverse, forward, update = (
            max(column) for column in zip(*costs[kinematics.MOST_VERTICES], strict=True)
        )
        assert (
            4 * inverse < forward <= 8 * inverse + 100
        )  # it was restless, and eight rounds were all it got
        assert update < inverse < 200

    def test_no_memory_is_asked_for_but_the_pins(self, library: Path) -> None:
        """Everything else is in the component from the start, and no function takes more of the
        stack than `MOST_STACK` (the compiler)."""
        told = subprocess.run(
            ["nm", "-u", library.with_name("component.o")],
            check=True,
            capture_output=True,
            text=True,
        ).stdout
        asked = {line.split()[-1] for line in told.splitlines()}
        assert {name for name in asked if "alloc" in name} == {"hal_malloc"}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    folder = tmp_path_factory.mktemp("whole")
    written(folder)
    return (folder / "lattice.csv").read_bytes()


class TestDamage:
    """A lattice that is not whole keeps LinuxCNC from starting, and the reason names file and
    row."""

    def refused(
        self, kins: Kins, folder: Path, data: bytes, rows: int, letters: str = "XYZ"
    ) -> bool:
        (folder / "damaged.csv").write_bytes(data)
        return kins.load(folder / "damaged.csv", rows, letters) != 0

    @few(30, suppress_health_check=[HealthCheck.function_scoped_fixture])
    @given(cut=st.floats(0.0, 1.0, exclude_max=True))
    def test_cut_off_anywhere(
        self, kins: Kins, tmp_path: Path, whole: bytes, cut: float
    ) -> None:
        assert self.refused(
            kins, tmp_path, whole[: int(len(whole) * cut)], whole.count(b"\n") - 1
        )

    @pytest.mark.parametrize("less", [-1, 1, 45, 100_000, 10**9])
    def test_not_the_rows_that_the_ini_file_says(
        self, kins: Kins, tmp_path: Path, whole: bytes, less: int
    ) -> None:
        assert self.refused(kins, tmp_path, whole, whole.count(b"\n") - 1 + less)

    @pytest.mark.parametrize(
        "mend",
        [
            lambda rows: [*rows[:3], rows[3].replace(b",", b";"), *rows[4:]],
            lambda rows: [*rows[:3], b"nan,0,0,0,0,0", *rows[4:]],
            lambda rows: [*rows[:3], rows[3] + b",1", *rows[4:]],
            lambda rows: [*rows[:3], rows[3] + b"7" * 300, *rows[4:]],
            lambda rows: [*rows[:3], rows[4], rows[3], *rows[5:]],
            lambda rows: [rows[0], *rows[2:], rows[1]],
            lambda rows: [rows[0].upper(), *rows[1:]],
            lambda rows: [*rows[:3], rows[3].rsplit(b",", 1)[0] + b",99999999", *rows[4:]],
        ],
    )
    def test_a_damaged_row(self, kins: Kins, tmp_path: Path, whole: bytes, mend) -> None:
        rows = whole.splitlines()
        assert self.refused(kins, tmp_path, b"\n".join(mend(rows)) + b"\n", len(rows) - 1)

    @pytest.mark.parametrize("letters", ["", "XY", "XYQ", "X" * 40, "XYZ,"])
    def test_joints_that_are_no_machine(
        self, kins: Kins, tmp_path: Path, whole: bytes, letters: str
    ) -> None:
        assert self.refused(kins, tmp_path, whole, whole.count(b"\n") - 1, letters)

    def test_no_file_at_all(self, kins: Kins, tmp_path: Path) -> None:
        assert kins.load(tmp_path / "nowhere.csv", 100) != 0


class TestExport:
    def test_everything_to_load_and_to_restore_is_there(self, tmp_path: Path) -> None:
        report = written(tmp_path)
        wanted = {
            "lattice.csv",
            "lattice_RESTORE.csv",
            "stepdiagkins.c",
            "stepdiagkins.hal",
            "ini_lines.txt",
            "ini_lines_RESTORE.txt",
            "EXPORT_REPORT.txt",
            "SHA256SUMS",
        }
        assert set(report.files) == wanted
        assert "vertices=405" in (tmp_path / "ini_lines.txt").read_text()  # 9 x 9 x 5
        assert "halcompile --install stepdiagkins.c" in report.text

    def test_nothing_is_left_but_the_bends_between_the_vertices(self, tmp_path: Path) -> None:
        written(tmp_path)
        before, after = verify_files(
            RESULT, read_given([tmp_path / "lattice.csv"])
        ).prediction.figures(rigid_motion=False)
        assert before.rms_um > 5
        assert after.rms_um < 0.05

    def test_a_second_survey_with_it_on_takes_its_place(self, tmp_path: Path) -> None:
        """Residuals of nothing, measured with the lattice active, give the same lattice again."""
        written(tmp_path / "first")
        data = (tmp_path / "first" / "lattice.csv").read_bytes()
        more = f'existing = ["lattice.csv"]\nactive_sha256 = ["{hashlib.sha256(data).hexdigest()}"]'
        text = profile_text(
            "linuxcnc",
            steps_mm=(50.0, 50.0, 50.0),
            references_mm=(-200.0, 0.0, -100.0),
            direction="mean",
        )
        text = (
            text.replace("joints =", 'way = "kinematics"\njoints =')
            .replace("existing = []", more)
            .replace('with = "off"', 'with = "on"')
        )
        on = parse_profile(
            text, "linuxcnc.toml", controller_named("linuxcnc"), VOLUME, {"lattice.csv": data}
        )
        export(made_result(), "linuxcnc", on, out_dir=tmp_path / "second")
        assert (tmp_path / "second" / "lattice.csv").read_bytes() == data
        assert (tmp_path / "second" / "lattice_RESTORE.csv").read_bytes() == data

    @pytest.mark.parametrize("known", [True, False])
    def test_a_slope_that_the_result_does_not_know_is_not_taken_out_unasked(
        self, tmp_path: Path, known: bool
    ) -> None:
        """The lattice takes the place of the screw's table: 80 µm over the travel, which were off
        while measuring."""
        screw = ControlFile(
            name="screw_x.comp", data=b"-200.0 -199.96 -199.96\n200.0 199.96 199.96\n"
        )
        of = replace(profile(), existing=(screw,))
        result = replace(
            RESULT,
            errors={
                **RESULT.errors,
                "EXX": replace(RESULT.errors["EXX"], slope_identified=known),
            },
        )
        if known:
            export(result, "linuxcnc", of, out_dir=tmp_path / "files")
            return
        with pytest.raises(SafetyError, match="the slope of the old table") as refused:
            export(result, "linuxcnc", of, out_dir=tmp_path / "files")
        assert refused.value.code == "old-table-lost.slope-of-table"
        export(
            result,
            "linuxcnc",
            of,
            accept=["old-table-lost.slope-of-table"],
            out_dir=tmp_path / "files",
        )

    def test_tables_that_were_active_do_not_merge_with_a_lattice(
        self, tmp_path: Path
    ) -> None:
        on = replace(profile(), machine=replace_machine(profile(), measured_with="on"))
        with pytest.raises(SafetyError, match="one lattice"):
            export(RESULT, "linuxcnc", on, out_dir=tmp_path)

    @pytest.mark.parametrize(
        ("limit", "code"),
        [
            ("value_um = 5.0", "value-large.lattice-limit"),
            ("slope_um_mm = 0.001", "slope-steep.lattice"),
            ("warn_value_um = 5.0", "value-large.lattice"),
        ],
    )
    def test_limits_hold_for_a_lattice_too(
        self, tmp_path: Path, limit: str, code: str
    ) -> None:
        text = profile_text(
            "linuxcnc",
            steps_mm=(50.0, 50.0, 50.0),
            references_mm=(-200.0, 0.0, -100.0),
            direction="mean",
        )
        text = (
            text.replace("joints =", 'way = "kinematics"\njoints =')
            + f"\n[limits]\n{limit}\n"
        )
        limited = parse_profile(
            text, "linuxcnc.toml", controller_named("linuxcnc"), VOLUME, {}
        )
        with pytest.raises(SafetyError) as refused:
            export(RESULT, "linuxcnc", limited, out_dir=tmp_path)
        assert refused.value.code == code
        assert not list(tmp_path.iterdir())

    @pytest.mark.parametrize(
        ("start_mm", "taken"),
        [(800.0, False), (-1200.0, False), (50.0, False), (0.0, True), (-600.0, True)],
    )
    def test_a_lattice_beside_the_measured_volume_is_refused(
        self, tmp_path: Path, start_mm: float, taken: bool
    ) -> None:
        """It would hold one value of its face over all that was measured, or do next to nothing. X
        was measured from -200 to 200 mm."""
        of = profile()
        end_mm = 200.0 if taken else start_mm + 400.0
        moved = msgspec.structs.replace(of.axes["X"], start_mm=start_mm, end_mm=end_mm)
        of = replace(of, axes={**of.axes, "X": moved})
        if taken:
            assert written(tmp_path / "out", of).files
            return
        with pytest.raises(
            SafetyError,
            match=f"the lattice covers X only from {start_mm:g} to {end_mm:g} mm, the measured "
            "travel is -200 to 200 mm",
        ) as refused:
            written(tmp_path / "out", of)
        assert refused.value.code == "beyond-travel.lattice"
        assert not (tmp_path / "out").exists()

    def test_more_vertices_than_it_has_room_for_are_refused(self, tmp_path: Path) -> None:
        with pytest.raises(SafetyError, match="65536"):
            export(RESULT, "linuxcnc", profile(), step_mm=4.0, out_dir=tmp_path)

    @pytest.mark.parametrize(
        "joints",
        [
            "{ X = [0], Y = [1] }",
            "{ X = [0], Y = [1], Z = [3] }",
            "{ X = [0], Y = [0], Z = [1] }",
        ],
    )
    def test_joints_with_a_gap_are_refused(self, tmp_path: Path, joints: str) -> None:
        with pytest.raises(UsageError, match="joints"):
            written(tmp_path, profile(joints=joints))

    def test_tables_cannot_be_planned_for_it(self) -> None:
        with pytest.raises(UsageError, match="kinematics"):
            controller_named("linuxcnc").plan([], profile())


def replace_machine(of: Profile, **changes: object) -> object:
    return msgspec.structs.replace(of.machine, **changes)
