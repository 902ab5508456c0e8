"""Any sequence of surveys, exports and loadings on one exact machine: before and after each, what
the machine really errs by.

The machine is the virtual one with all its errors, surveys find its field without an error of their
own, files are written and judged by the command line, and a plant (`testkit.exact.plants`) keeps
what is loaded into it.
"""

import hashlib
import json
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from stepdiag.base.result.field import error_field_um, without_rigid_motion
from stepdiag.base.result.result import DISPLACEMENTS, ROTATIONS, Quantity, Result
from stepdiag.base.volume import Volume, anywhere_mm
from stepdiag.virtual.physics.error_functions import Amplitudes, random_errors
from stepdiag.virtual.physics.machine import Machine
from testkit.cli import stepdiag
from testkit.exact.machines import OLD
from testkit.exact.members import members
from testkit.exact.plants import PLANTS, Plant
from testkit.exact.results import made_result

STEP_MM = 25.0
ACCEPTED = (
    "change-large",
    "slope-steep",
    "correction-small",
    "value-large",
    "profile-assumed",
    "travel-not-covered",
)
LEAVES_UM = 0.3
"""What the rounding of tables may add to the rms: beside 2 %, the limit from which an export
refuses."""
EXACT_UM = 0.01
"""What two programs may differ by that read the same tables: units of the last digit, at points
beside a step of a stepped table."""


@dataclass(frozen=True, kw_only=True)
class Step:
    """One survey with what was loaded after it: exit codes, true rms in um before and after in its
    volume, predicted interval."""

    maker: str
    asked: str
    code: int
    refusal: str = ""
    judged: int = 0
    said: str = ""
    before_um: float = 0.0
    after_um: float = 0.0
    predicted_um: float = 0.0
    unseen_um: float = 0.0
    """What the survey's curves do not know of the machine as it was measured, between their nodes
    and in its angles (rms)."""
    entered: str = ""
    """The backlash that somebody entered by hand after loading, as the export offered it, by
    axis."""
    known_um: float = 0.0
    """What the machine errs by afterwards without that: what the survey's curves and the loaded
    tables make together (rms)."""
    restored_um: float = 0.0

    @property
    def worse(self) -> bool:
        """Tell whether the machine errs more than before: by more than rounding, and more than what
        no survey could know of it twice.

        The export promises it of the field that it knows, which is ``unseen_um`` off before and
        after.
        """
        return self.after_um > self.before_um * 1.02 + LEAVES_UM + 2.0 * self.unseen_um

    @property
    def mispredicted(self) -> bool:
        """Tell whether the tables move the machine otherwise than the export took them for.

        What its survey did not see is taken off the machine: then nothing is left between what was
        said of it and what it does.
        """
        return abs(self.known_um - self.predicted_um) > EXACT_UM


class Sequence:
    """Surveys and exports on one machine, drawn by a seed."""

    def __init__(self, seed: int, maker: str, folder: Path) -> None:
        self.rng, self.hand = np.random.default_rng(seed), np.random.default_rng([seed, 1])
        self.maker, self.folder = maker, folder
        self.chain = str(self.rng.choice(["FXYZ", "XYFZ", "XFYZ", "ZYXF"]))
        far = self.rng.choice([0.0, 1.0])
        self.low = np.round(
            self.rng.uniform(-3000.0, 2000.0, 3) * far / 100.0
        ) * 100.0 - np.array([200.0, 0.0, 300.0]) * (1.0 - far)
        self.size = np.array([400.0, 400.0, 300.0])
        self.angle_urad = angle = float(self.rng.choice([0.0, 10.0]))
        self.held = int(self.rng.choice([0, 0, 8, 12]))
        self.sections = int(self.rng.choice([1, 1, 1, 2]))
        wanted = Amplitudes(
            positioning_um=9.0,
            straightness_um=7.0,
            angle_urad=angle,
            scale_um_m=20.0,
            squareness_urad=20.0,
        )
        low = (float(self.low[0]), float(self.low[1]), float(self.low[2]))
        self.machine = Machine(
            errors=random_errors(seed, low, (400.0, 400.0, 300.0), wanted), chain=self.chain
        )
        turns = self.rng.random() < 0.3
        self.turned_um = (
            np.array([float(self.rng.uniform(-4.0, 4.0)) for _ in "XYZ"])
            if turns
            else np.zeros(3)
        )
        self.plant: Plant = PLANTS[maker](self.chain, low)
        self.reference_mm = low

    def steps(self, count: int) -> Iterator[Step]:
        """Yield what each survey led to."""
        for number in range(count):
            yield self._step(self.folder / str(number))

    def _step(self, folder: Path) -> Step:
        rng, plant = self.rng, self.plant
        folder.mkdir(parents=True)
        own = plant.own()
        measured_on = bool(own) and bool(plant.tables()) and rng.random() < 0.6
        sections, volume = self._volume()
        result = self._result(volume, measured_on)
        names, words = self._asked()
        for name, data in own.items():
            (folder / name).write_bytes(data)
        digests = [
            {
                "name": n,
                "sha256": hashlib.sha256(d).hexdigest(),
                "date": "2026-01-01",
                "source": "archive",
            }
            for n, d in own.items()
        ]
        survey = (
            {"machine": "m", "compensation": "on", "active_files": digests}
            if measured_on
            else {"machine": "m", "compensation": "off"}
        )
        (folder / "result.json").write_text(
            replace(result, **members(survey=survey)).to_json(), encoding="utf-8"
        )
        text = self._profile(volume, sections, list(own), names, words, measured_on)
        (folder / "profile.toml").write_text(text, encoding="utf-8")
        asked = (
            f"{'on' if measured_on else 'off'} {words.get('direction', '')} "
            f"{','.join(names) or 'all'} {words['section'].strip()} {volume}"
        )
        accept = [word for code in ACCEPTED for word in ("--accept", code)]
        arguments = (
            folder / "result.json",
            "--controller",
            self.maker,
            "--profile",
            folder / "profile.toml",
            "--out",
            folder / "out",
        )
        told = stepdiag("export", *arguments, *accept, "--json")
        if told.code:
            return Step(maker=self.maker, asked=asked, code=told.code, refusal=told.refusal)
        judged = stepdiag(
            "verify",
            folder / "result.json",
            folder / "out",
            "--profile",
            folder / "profile.toml",
        )
        found = json.loads(told.out)["predicted"]["without_rigid_motion"]["after"]["rms_um"]
        points = anywhere_mm(volume)
        moved = plant.moved_um(points)
        before = self._both_ways_um(volume, points)
        measured = self.machine.error_at(points) + (moved if measured_on else 0.0)
        unseen = (
            measured
            - error_field_um(result, points)
            - (self._steps_between_um(volume, points) if measured_on else 0.0)
        )
        plant.load(folder / "out")
        entered = self._enter(
            [
                finding["text"]
                for finding in json.loads(told.out)["findings"]
                if finding["code"] == "reversal-value"
            ]
        )
        after, restored = self.machine.error_at(points) + plant.moved_um(points), 0.0
        after_um = self._both_ways_um(volume, points)
        if rng.random() < 0.3:
            plant.load(folder / "out", restore=True)
            restored = float(np.max(np.abs(plant.moved_um(points) - moved)))
            if rng.random() < 0.5:
                plant.load(folder / "out")
        return Step(
            maker=self.maker,
            asked=asked,
            code=0,
            judged=judged.code,
            said=judged.out + judged.refusal,
            before_um=before,
            after_um=after_um,
            predicted_um=found["value"],
            unseen_um=self._rms_um(volume, unseen),
            known_um=self._rms_um(volume, after - unseen),
            restored_um=restored,
            entered=entered,
        )

    def _both_ways_um(self, volume: Volume, points: np.ndarray) -> float:
        """Return what the machine errs by as it is now, over both directions of travel (rms)."""
        mean = self._rms_um(
            volume, self.machine.error_at(points) + self.plant.moved_um(points)
        )
        half = (self.turned_um + self.plant.turned_um(points, tables=True)) / 2.0
        return float(np.hypot(mean, np.sqrt(np.mean(np.sum(half**2, axis=1)))))

    def _enter(self, offers: list[str]) -> str:
        """Enter the backlash as the export offers it, mostly; a number that a table keeps the
        control from looking at is left."""
        entered = []
        for text in offers:
            axis, more = (
                "XYZ".index(text[1]),
                float(text.split("The backlash is ")[1].split(" µm")[0]),
            )
            if "both" not in text.split("(k = 2): ")[1] and self.hand.random() < 0.8:
                goes = re.search(r"from (\S+) µm to (\S+) µm$", text)
                self.plant.backlash_um[axis] = (
                    float(goes[2]) if goes else self.plant.backlash_um[axis] + more
                )
                entered.append(f"{text[1]} {self.plant.backlash_um[axis]:.2f}")
        return ", ".join(entered)

    def _volume(self) -> tuple[int, Volume]:
        """Draw a volume within the travel, on a grid of 50 mm, mostly all of it."""
        low, size = self.low.copy(), self.size.copy()
        if self.rng.random() < 0.3:
            axis = int(self.rng.integers(3))
            size[axis] /= 2.0
            low[axis] += size[axis] * self.rng.integers(2)
        sections = self.sections if self.rng.random() < 0.8 else 3 - self.sections
        return sections, Volume(
            origin_mm=tuple(map(float, low)), size_mm=tuple(map(float, size)), increments=10
        )

    def _points(self, volume: Volume, nodes: int) -> np.ndarray:
        axes = [
            low + size * np.linspace(0.0, 1.0, nodes)
            for low, size in zip(volume.origin_mm, volume.size_mm, strict=True)
        ]
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)

    def _steps_between_um(self, volume: Volume, points: np.ndarray) -> np.ndarray:
        """Return what steps of the control do between the nodes of a survey, where its straight
        lines do not see them."""
        found = np.zeros(points.shape)
        for axis in range(3):
            nodes = np.tile(points[0], (volume.increments + 1, 1))
            along = np.tile(points[0], (len(points), 1))
            nodes[:, axis], along[:, axis] = volume.nodes_mm(axis), points[:, axis]
            at_nodes = self.plant.steps_um(nodes)
            seen = [
                np.interp(along[:, axis], nodes[:, axis], at_nodes[:, output])
                for output in range(3)
            ]
            found += self.plant.steps_um(along) - np.stack(seen, axis=-1)
        return found

    def _rms_um(self, volume: Volume, errors_um: np.ndarray) -> float:
        left = without_rigid_motion(volume, anywhere_mm(volume), errors_um)
        return float(np.sqrt(np.mean(np.sum(left**2, axis=1))))

    def _result(self, volume: Volume, measured_on: bool) -> Result:
        """Return what a perfect survey finds: the curves that fit the field best, angles and all
        where an autocollimator was there."""
        nodes = volume.increments + 1
        points = self._points(volume, nodes)
        field = self.machine.error_at(points) + (
            self.plant.moved_um(points) if measured_on else 0.0
        )
        angles: dict[str, np.ndarray] = {}
        lean = self.maker in ("siemens", "beckhoff", "heidenhain", "linuxcnc")
        if not measured_on and lean and self.rng.random() < 0.5:
            for name in ROTATIONS:
                axis = "XYZ".index(name[2])
                at = volume.nodes_mm(axis)
                turned = self.machine.errors.rotation_urad(axis, at, np.zeros(at.shape))[
                    :, "ABC".index(name[1])
                ]
                angles[name] = turned - turned[0]
            alone = made_result({}, angles=angles, chain=self.chain, volume=volume)
            field = field - error_field_um(alone, points)
        cube = field.reshape(nodes, nodes, nodes, 3)
        values, slopes = {}, {}
        for name in DISPLACEMENTS:
            output, axis = "XYZ".index(name[1]), "XYZ".index(name[2])
            curve = cube[..., output].mean(axis=tuple({0, 1, 2} - {axis}))
            curve = curve - curve[0]
            at = volume.nodes_mm(axis)
            slopes[name] = 0.0 if name[1] == name[2] else float(curve[-1] / (at[-1] - at[0]))
            values[name] = curve - slopes[name] * (at - at[0])
        square = {
            "C0Y": -1e3 * (slopes["EXY"] + slopes["EYX"]),
            "B0Z": 1e3 * (slopes["EXZ"] + slopes["EZX"]),
            "A0Z": -1e3 * (slopes["EYZ"] + slopes["EZY"]),
        }
        turned = (self.turned_um + self.plant.turned_um(points, tables=measured_on)).reshape(
            nodes, nodes, nodes, 3
        )
        back = {
            f"E{each}{each}": turned[..., axis].mean(axis=tuple({0, 1, 2} - {axis}))
            for axis, each in enumerate("XYZ")
        }
        made = made_result(
            values,
            squareness=square,
            reversal=back,
            angles=angles,
            chain=self.chain,
            volume=volume,
            u_um=0.05,
        )
        known = {name: Quantity(value=value, u=0.2) for name, value in square.items()}
        numbers = {
            name[1]: {"value": float(np.mean(value)), "u": 0.05, "unit": "um"}
            for name, value in back.items()
        }
        return replace(made, squareness=known, **members(backlash=numbers))

    def _asked(self) -> tuple[list[str], dict[str, str]]:
        """Draw the functions that are exported, and the section of the control."""
        rng = self.rng
        names: list[str] = []
        if rng.random() < 0.5:
            drawn = rng.permutation(DISPLACEMENTS)[: int(rng.integers(1, 8))]
            names = [name for name in DISPLACEMENTS if name in drawn]
        if self.maker in ("fanuc", "fagor"):
            names = (
                names
                and [name for name in names if name[1] == name[2] or self.maker == "fanuc"]
            ) or ["EXX", "EYY", "EZZ"]
        section = self._section()
        if '"lists"' in section:
            cross = {
                letter: str(rng.choice([other for other in "XYZ" if other != letter]))
                for letter in "XYZ"
            }
            names = [
                name
                for name in DISPLACEMENTS
                if name[1] == name[2] or cross[name[1]] == name[2]
            ]
        return names, {
            "section": section,
            "direction": "both" if self._directional() and rng.random() < 0.7 else "mean",
        }

    def _directional(self) -> bool:
        return bool(self.turned_um.any()) and self.maker in ("siemens", "linuxcnc", "fagor")

    def _section(self) -> str:
        rng = self.rng
        chain = f'chain = "{self.chain}"\n' if rng.random() < 0.5 else ""
        if self.maker == "siemens":
            more = (
                f"cec_tables_held = {self.held}\n"
                if self.held
                else f"first_cec_table = {int(rng.choice([0, 0, 3, 20]))}\n"
            )
            products = "true" if rng.random() < 0.6 else "false"
            return (
                f"[siemens]\n{OLD}measuring_system = 1\neec_points = "
                f"{{X=50,Y=50,Z=50}}\ncec_points = 60\nproducts = {products}\n{more}"
            )
        if self.maker == "fanuc":
            axes = "".join(
                f"[fanuc.axes.{a}]\nnumber = {n}\nreference_point = {200 * n - 100}\n"
                for n, a in enumerate("XYZ", start=1)
            )
            option = "true" if rng.random() < 0.6 else "false"
            return (
                "[fanuc]\ndetection_unit_um = 1.0\nincrement_limit = 127\nstraightness_option = "
                f"{option}\n{axes}"
            )
        if self.maker == "heidenhain":
            return f'[heidenhain]\ngeneration = "itnc530"\n{chain}'
        if self.maker == "beckhoff" and rng.random() < 0.7:
            return (
                '[beckhoff]\nway = "volumetric"\ncross_sense = "as-error"\naxis_numbers = '
                f"{{X=1,Y=2,Z=3}}\nturned = false\n{chain}"
            )
        if self.maker == "beckhoff":
            return (
                '[beckhoff]\nway = "lists"\ncross_sense = "as-error"\naxis_numbers = '
                "{X=1,Y=2,Z=3}\n"
            )
        if self.maker == "linuxcnc":
            way = rng.choice(["screw", "screw", "kinematics"])
            return f'[linuxcnc]\njoints = {{X=[0],Y=[1],Z=[2]}}\nway = "{way}"\n'
        if self.maker == "mitsubishi":
            return (
                '[mitsubishi]\noutput_unit_um = 0.5\ndata = "incremental"\nfirst_data = '
                f"{int(rng.choice([4101, 4101, 4500]))}\n"
            )
        return "[fagor]\n"

    def _profile(
        self,
        volume: Volume,
        sections: int,
        existing: list[str],
        names: list[str],
        words: dict[str, str],
        measured_on: bool,
    ) -> str:
        """Return the profile: tables over the measured volume, or over the whole travel of the
        axes; referenced at the low end."""
        whole = self.rng.random() < 0.6 or self.maker in ("fanuc", "mitsubishi")
        lines = [
            "[machine]",
            'name = "m"',
            f'controller = "{self.maker}"',
            f'measured_with = "{"on" if measured_on else "off"}"',
        ]
        lines += [
            f'direction = "{words["direction"]}"',
            f"existing = {existing}",
            *([f"functions = {names}"] if names else []),
        ]
        for axis, letter in enumerate("XYZ"):
            start = float(self.low[axis]) if whole else volume.origin_mm[axis]
            end = (
                float(self.low[axis] + self.size[axis])
                if whole
                else volume.origin_mm[axis] + volume.size_mm[axis]
            )
            lines += [
                f"[axes.{letter}]",
                f'name = "AX{axis + 1}"',
                f"step_mm = {STEP_MM * sections}",
            ]
            said = (
                self.maker == "linuxcnc"
                or words["direction"] == "both"
                or self.hand.random() < 0.7
            )
            lines += [f"backlash_um = {self.plant.backlash_um[axis]}"] if said else []
            lines += [f"reference_mm = {start}", f"start_mm = {start}", f"end_mm = {end}"]
        return "\n".join(
            [
                *lines,
                "[limits]\nslope_um_mm = 5.0\nvalue_um = 300.0\nwarn_value_um = 200.0",
                words["section"],
            ]
        )
