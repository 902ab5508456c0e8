#!/usr/bin/python3
"""stepdiag_back: read from HAL the values that LinuxCNC adds at every row of its COMP_FILEs, while
READ_BACK.ngc runs, and write them as COMP_FILEs.

    /usr/bin/python3 stepdiag_back.py 0 screw_x.comp 1 screw_y.comp 2 screw_z.comp

Each pair of arguments is a joint and its COMP_FILE; the script writes held_screw_x.comp beside
itself, with the same rows and the active values. If the axes did not stop at a row from both sides,
the script reports the row and does not write its file (exit code 1). The script needs only the
control's own Python.
"""

import sys
import time
from collections.abc import Iterator
from pathlib import Path

POLL_S, STILL_S, QUIET_S = 0.01, 0.25, 60.0
NEAR, STIR = 1e-4, 1e-9
"""Distance within which an axis stands at a row, and change of a command that counts as motion, in
units of the machine.
"""


class Reader:
    """The rows of each joint, and the added value at each row, approached from below (+1) and from
    above (-1).
    """

    def __init__(self, rows: dict[int, list[float]]) -> None:
        self.rows = rows
        self.added: dict[int, dict[tuple[int, int], float]] = {joint: {} for joint in rows}
        self._last: dict[int, float] = {}
        self._still_since: float | None = None
        self._stop: dict[int, float] = {}
        self._taken = True

    @property
    def missing(self) -> list[tuple[int, float, int]]:
        """Return joint, position and direction of every row whose added value is not yet read."""
        return [
            (joint, at, way)
            for joint, rows in self.rows.items()
            for index, at in enumerate(rows)
            for way in (1, -1)
            if (index, way) not in self.added[joint]
        ]

    def see(self, now_s: float, commanded: dict[int, float], added: dict[int, float]) -> None:
        """Record the commanded positions of the joints and the added values; a stop counts if it
        lasts for `STILL_S`.
        """
        if any(
            abs(commanded[joint] - self._last.get(joint, 1e300)) > STIR for joint in commanded
        ):
            self._last, self._still_since, self._taken = dict(commanded), now_s, False
        if self._taken or self._still_since is None or now_s - self._still_since < STILL_S:
            return
        self._taken = True
        for joint, rows in self.rows.items():
            before, at = self._stop.get(joint, commanded[joint]), commanded[joint]
            if abs(at - before) > NEAR:
                for index, row in enumerate(rows):
                    if abs(row - at) < NEAR:
                        self.added[joint][index, 1 if at > before else -1] = added[joint]
        self._stop = dict(commanded)

    def lines(self, joint: int) -> Iterator[str]:
        """Yield the rows of a COMP_FILE of type 0 from the compensation in the control."""
        for index, at in enumerate(self.rows[joint]):
            forward, reverse = (at - self.added[joint][index, way] for way in (1, -1))
            yield f"{at:.6f} {forward:.6f} {reverse:.6f}"


def main(words: list[str]) -> int:
    """Watch the control until every row is read, or no axis has moved for a minute."""
    import hal

    joints = [int(word) for word in words[::2]]
    paths = [Path(word) for word in words[1::2]]
    reader = Reader(
        {
            joint: [
                float(line.split()[0])
                for line in path.read_text(encoding="ascii").splitlines()
            ]
            for joint, path in zip(joints, paths, strict=True)
        }
    )
    component = hal.component("stepdiag-back")
    component.ready()
    moved_s, last = time.monotonic(), None
    while reader.missing and time.monotonic() - moved_s < QUIET_S:
        read = {
            joint: [
                hal.get_value(f"joint.{joint}.{pin}")
                for pin in ("pos-cmd", "motor-pos-cmd", "motor-offset")
            ]
            for joint in joints
        }
        now = time.monotonic()
        commanded = {joint: pins[0] for joint, pins in read.items()}
        moved_s, last = (moved_s, last) if commanded == last else (now, commanded)
        reader.see(
            now,
            commanded,
            {joint: motor - at - offset for joint, (at, motor, offset) in read.items()},
        )
        time.sleep(POLL_S)
    for joint, at, way in reader.missing:
        sys.stderr.write(
            f"joint {joint}: no stop at {at:g} from {'below' if way > 0 else 'above'}\n"
        )
    for joint, path in zip(joints, paths, strict=True):
        if not any(each == joint for each, _, _ in reader.missing):
            held = path.with_name(f"held_{path.name}")
            held.write_text("\n".join([*reader.lines(joint), ""]), encoding="ascii")
            sys.stdout.write(f"{held}\n")
    return 1 if reader.missing else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
