"""A real control for the system test: LinuxCNC with a simulated three-axis machine, headless, one
at a time on a computer.

LinuxCNC runs as a process of its own with the system's Python; `bridge` is its operator and tells
this side, over a Unix socket, what the control does. Baselines.md, section LinuxCNC headless, names
the environment it needs.
"""

import fcntl
import json
import os
import shutil
import signal
import socket
import subprocess
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from stepdiag.exporters.programs import companion_files
from stepdiag.virtual.base.reserved import reserved_port

PACKAGES = ("linuxcnc-uspace", "linuxcnc-uspace-dev", "gcc", "libc6-dev")
CHECKOUT = Path(__file__).parents[4]
BRIDGE = Path(__file__).with_name("bridge.py")
ORDINARY_UID = 65534
ORDINARY_MM_S2, SWIFT_MM_S2 = 5000, 20000

INI = """\
[EMC]
VERSION = 1.1
MACHINE = stepdiag rig
[DISPLAY]
DISPLAY = {folder}/bridge.py
[TASK]
TASK = milltask
CYCLE_TIME = 0.001
[RS274NGC]
PARAMETER_FILE = rig.var
[EMCMOT]
EMCMOT = motmod
COMM_TIMEOUT = 5.0
SERVO_PERIOD = 1000000
[EMCIO]
EMCIO = io
CYCLE_TIME = 0.05
TOOL_TABLE = rig.tbl
[HAL]
HALFILE = rig.hal
HALFILE = stepdiag.hal
{halfiles}[KINS]
KINEMATICS = {kinematics}
JOINTS = 3
[TRAJ]
COORDINATES = XYZ
LINEAR_UNITS = mm
ANGULAR_UNITS = degree
MAX_LINEAR_VELOCITY = 2000
DEFAULT_LINEAR_VELOCITY = 1000
"""
INI_AXIS = """\
[AXIS_{axis}]
MIN_LIMIT = -2000
MAX_LIMIT = 2000
MAX_VELOCITY = 2000
MAX_ACCELERATION = {acceleration}
[JOINT_{joint}]
TYPE = LINEAR
HOME = 0
HOME_SEQUENCE = 0
HOME_SEARCH_VEL = 0
HOME_LATCH_VEL = 0
MIN_LIMIT = -2000
MAX_LIMIT = 2000
MAX_VELOCITY = 2000
MAX_ACCELERATION = {acceleration}
FERROR = 100
MIN_FERROR = 100
"""
INI_COMP = "COMP_FILE = {name}\nCOMP_FILE_TYPE = 0\n"
HAL = """\
loadrt [KINS]KINEMATICS
loadrt [EMCMOT]EMCMOT servo_period_nsec=[EMCMOT]SERVO_PERIOD num_joints=[KINS]JOINTS num_dio=4 num_aio=4
addf motion-command-handler servo-thread
addf motion-controller servo-thread
net motor-0 joint.0.motor-pos-cmd => joint.0.motor-pos-fb
net motor-1 joint.1.motor-pos-cmd => joint.1.motor-pos-fb
net motor-2 joint.2.motor-pos-cmd => joint.2.motor-pos-fb
net enable iocontrol.0.user-enable-out => iocontrol.0.emc-enable-in
net prepare iocontrol.0.tool-prepare => iocontrol.0.tool-prepared
net change iocontrol.0.tool-change => iocontrol.0.tool-changed
"""  # noqa: E501


@dataclass(frozen=True)
class State:
    """The control at ``time_ns`` (CLOCK_MONOTONIC): positions in mm, what the program shows the
    PLC, programs started so far."""

    time_ns: int
    motor_mm: tuple[float, ...]
    commanded_mm: tuple[float, ...]
    setup: int
    count: int
    stopped: bool
    in_position: bool
    running: bool
    started: int


class Control:
    """A running LinuxCNC. ``on_state`` is called with every state, in the thread that reads
    them."""

    def __init__(self, link: socket.socket, folder: Path, plc_port: int) -> None:
        self.plc_port = plc_port
        """Where the product's own component serves the register block, on loopback."""
        self._link = link
        self._folder = folder
        self._changed = threading.Condition()
        self._state: State | None = None
        self._failure = ""
        self.on_state: Callable[[State], None] = lambda state: None
        self._reader = threading.Thread(target=self._read, name="linuxcnc-rig")
        self._reader.start()

    @property
    def state(self) -> State:
        """Return the newest state."""
        return self.wait_for(lambda state: True)

    def wait_for(self, wanted: Callable[[State], bool], timeout_s: float = 200.0) -> State:
        """Return the first state from now on that is wanted. Raises AssertionError when the control
        fails or time is up."""
        with self._changed:
            ready = self._changed.wait_for(
                lambda: self._failure or (self._state is not None and wanted(self._state)),
                timeout_s,
            )
            assert not self._failure, self._failure
            assert ready, (
                f"nothing like it within {timeout_s} s; the control says {self._state}"
            )
            assert self._state is not None
            return self._state

    def run(self, program: bytes, timeout_s: float = 300.0) -> None:
        """Drive an NC program to its end."""
        before = self.state.started
        path = self._folder / "program.ngc"
        path.write_bytes(program)
        self._order({"run": str(path)})
        self.wait_for(lambda state: state.started > before and state.running)
        self.wait_for(lambda state: not state.running, timeout_s)

    @property
    def folder(self) -> Path:
        """Return the folder of the configuration, where the COMP_FILEs lie."""
        return self._folder

    def set(self, pin: str, value: str) -> None:
        """Set a HAL pin, as a person does at ``halcmd``."""
        self._order({"set": [pin, value]})

    def quit(self) -> None:
        """Let the operator leave; the control shuts down behind him."""
        self._order({"quit": True})
        self._reader.join()

    def _order(self, order: Mapping[str, object]) -> None:
        self._link.sendall(json.dumps(order).encode() + b"\n")

    def _read(self) -> None:
        try:
            with self._link.makefile("rb") as lines:
                for line in lines:
                    self._take(json.loads(line))
        except OSError as error:
            self._fail(f"the bridge is gone: {error}")
        self._fail("LinuxCNC has ended")

    def _take(self, told: dict[str, object]) -> None:
        error = told.pop("error", None)
        state = State(
            **{
                key: tuple(value) if isinstance(value, list) else value
                for key, value in told.items()
            }
        )
        self.on_state(state)
        with self._changed:
            self._state = state
            self._changed.notify_all()
        if error is not None:
            self._fail(f"LinuxCNC: {error}")

    def _fail(self, failure: str) -> None:
        with self._changed:
            self._failure = self._failure or failure
            self._changed.notify_all()


@contextmanager
def linuxcnc(
    comp_files: Mapping[str, bytes] | None = None,
    kinematics: Mapping[str, bytes] | None = None,
    *,
    backlash_mm: Mapping[str, float] | None = None,
    swift: bool = False,
    prepared: Callable[[Path], None] = lambda ini: None,
) -> Iterator[Control]:
    """Run LinuxCNC with the machine switched on and homed, and the product's component that serves
    its signals.

    ``comp_files`` are COMP_FILEs (type 0) and ``backlash_mm`` the BACKLASH of the joints, by axis
    letter; ``kinematics`` are the files of an export of the kinematics component, which is built
    and loaded as its report says. ``prepared`` is called with the INI file before the control
    starts. A ``swift`` control saves the tests' time; at its acceleration a
    joint swings back by a hair when it stops, and a COMP_FILE of two different columns then shows
    the other one. Installs the Debian packages where they are missing. Raises AssertionError where
    they cannot be had or the control does not start.
    """
    installed()
    with (
        _alone(),
        tempfile.TemporaryDirectory(
            prefix="stepdiag-linuxcnc-", ignore_cleanup_errors=True
        ) as name,
    ):
        folder = Path(name)
        plc_port = reserved_port()
        _configured(
            folder,
            comp_files or {},
            kinematics or {},
            backlash_mm or {},
            plc_port,
            SWIFT_MM_S2 if swift else ORDINARY_MM_S2,
        )
        prepared(folder / "rig.ini")
        with socket.socket(socket.AF_UNIX) as door:
            door.bind(str(folder / "rig.socket"))
            (folder / "rig.socket").chmod(0o666)
            door.listen(1)
            door.settimeout(60.0)
            yield from _running(folder, door, plc_port)


def installed() -> None:
    """Install LinuxCNC if it is missing. Raises AssertionError where that fails: the test of the
    real control is never skipped."""
    if shutil.which("linuxcnc") and shutil.which("halcompile"):
        return
    done = subprocess.run(
        ["tools/debian", *PACKAGES],
        cwd=CHECKOUT,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
    assert shutil.which("halcompile"), (
        f"the Debian packages {', '.join(PACKAGES)} cannot be installed, so the control is not "
        f"tested: {done.stderr[-2000:]}"
    )


def _as_root(command: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    as_root = [] if os.geteuid() == 0 else ["sudo", "-n"]
    return subprocess.run(
        [*as_root, *command], capture_output=True, text=True, check=False, cwd=folder
    )


@contextmanager
def _alone() -> Iterator[None]:
    """Hold the one place that LinuxCNC has on a computer: fixed shared-memory keys."""
    with (Path(tempfile.gettempdir()) / "stepdiag-linuxcnc.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def _configured(
    folder: Path,
    comp_files: Mapping[str, bytes],
    kinematics: Mapping[str, bytes],
    backlash_mm: Mapping[str, float],
    plc_port: int,
    acceleration: int,
) -> None:
    """Write the configuration; the folder is open to the ordinary user as whom LinuxCNC's real-time
    part runs."""
    folder.chmod(0o777)
    for file in companion_files("linuxcnc", "127.0.0.1", plc_port):
        (folder / file.name).write_bytes(file.data)
    for name, data in kinematics.items():
        (folder / name).write_bytes(data)
    line, halfiles = (
        _kinematics_lines(folder) if kinematics else ("trivkins coordinates=XYZ", "")
    )
    ini = INI.format(folder=folder, kinematics=line, halfiles=halfiles)
    for joint, axis in enumerate("XYZ"):
        ini += INI_AXIS.format(axis=axis, joint=joint, acceleration=acceleration)
        if axis in backlash_mm:
            ini += f"BACKLASH = {backlash_mm[axis]}\n"
        if axis in comp_files:
            (folder / f"{axis}.comp").write_bytes(comp_files[axis])
            ini += INI_COMP.format(name=f"{axis}.comp")
    (folder / "rig.ini").write_text(ini, encoding="ascii")
    (folder / "rig.hal").write_text(HAL, encoding="ascii")
    (folder / "rig.tbl").write_text("", encoding="ascii")
    shutil.copy(BRIDGE, folder / "bridge.py")
    (folder / "bridge.py").chmod(0o755)


def _kinematics_lines(folder: Path) -> tuple[str, str]:
    """Build the component as the export's report says, and return what its ini_lines.txt gives:
    KINEMATICS, and the HALFILE line."""
    built = _as_root(["halcompile", "--install", "stepdiagkins.c"], folder)
    assert built.returncode == 0, built.stdout + built.stderr
    lines = dict(
        line.split(" = ", 1)
        for line in (folder / "ini_lines.txt").read_text(encoding="ascii").splitlines()
        if " = " in line
    )
    return lines["KINEMATICS"], f"HALFILE = {lines['HALFILE']}\n"


def _running(folder: Path, door: socket.socket, plc_port: int) -> Iterator[Control]:
    environment = {
        "PATH": "/usr/bin:/bin:/usr/sbin:/sbin",
        "HOME": str(folder),
        "RUNTESTS": "1",
        "RTAPI_FIFO_PATH": str(folder / "fifo"),
        "STEPDIAG_RIG": str(folder / "rig.socket"),
    }
    if os.geteuid() == 0:
        environment["RTAPI_UID"] = str(ORDINARY_UID)
    log = folder / "linuxcnc.log"
    with log.open("wb") as output:
        process = subprocess.Popen(
            ["/usr/bin/linuxcnc", "rig.ini"],
            cwd=folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
    try:
        yield from _served(door, folder, log, plc_port)
    finally:
        try:
            process.wait(60.0)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def _served(door: socket.socket, folder: Path, log: Path, plc_port: int) -> Iterator[Control]:
    try:
        link, _ = door.accept()
    except TimeoutError:
        raise AssertionError(
            f"LinuxCNC does not start: {log.read_text(errors='replace')[-3000:]}"
        ) from None
    with link:
        control = Control(link, folder, plc_port)
        try:
            control.wait_for(lambda state: True)
            yield control
        finally:
            control.quit()
