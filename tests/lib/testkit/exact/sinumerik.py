"""A SINUMERIK as far as part programs see it: variables, switches and weights as state, and the
statements of loading and reading back.

Written from the meaning of the statements (assignments, IF .. GOTOF, FOR .. ENDFOR, WRITE, DELETE,
STOPRE, NEWCONF), it shares no code with the product. A table may be written only while its switch
is off.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

_SET = re.compile(r"^(\$[A-Z_]+\[[^\]]*\]|[A-Z]+)=(.*)$")
_IF = re.compile(r"^IF (.+?)(==|<>|<)(.+) GOTOF (\w+)$")


@dataclass
class Sinumerik:
    """``held`` are the variables by their whole name; ``machine`` those that stand in machine data
    and are not written by programs."""

    held: dict[str, str] = field(default_factory=dict)
    machine: Mapping[str, str] = field(default_factory=dict)
    largest_lines: int = 100_000
    files: dict[str, list[str]] = field(default_factory=dict)
    shown: list[str] = field(default_factory=list)
    stop_after: int | None = None
    """Statements after which somebody presses reset: a loading that ends half way."""

    @property
    def refused(self) -> bool:
        """Tell whether the last program ended with nothing written."""
        return "NOTHING WRITTEN" in self.shown[-1] if self.shown else False

    def run(self, text: str) -> None:
        """Run a part program to its end, or to the reset."""
        lines = [
            line.partition(";")[0].strip() if '"' not in line else line.strip()
            for line in text.splitlines()
        ]
        lines = [line for line in lines if line and not line.startswith(";")]
        local: dict[str, str] = {}
        at, done, loops = 0, 0, []
        while at < len(lines):
            if self.stop_after is not None and done >= self.stop_after:
                return
            line, done = lines[at], done + 1
            at += 1
            if line in ("M30", "M17"):
                return
            if line.startswith("IF (ABS("):
                tests = re.findall(r"\(ABS\((\w+)-\((\S+?)\)\)>(\S+?)\)", line)
                if all(
                    abs(float(local[name]) - float(less)) > float(most)
                    for name, less, most in tests
                ):
                    at = lines.index(f"{line.split()[-1]}:") + 1
            elif match := re.match(r"^(\w+)=\1\+\((\w+)\+1\)\*(\$.+)$", line):
                local[match[1]] = (
                    f"{float(local[match[1]]) + (float(local[match[2]]) + 1) * float(self._value(match[3], local)):.9f}"  # noqa: E501
                )
            elif match := _IF.match(line):
                one, two = (
                    _number(self._value(each, local)) for each in (match[1], match[3])
                )
                if {"==": one == two, "<>": one != two, "<": match[2] == "<" and one < two}[
                    match[2]
                ]:
                    at = lines.index(f"{match[4]}:") + 1
            elif line.startswith("FOR "):
                name, first, last = re.match(r"FOR (\w+)=(.+) TO (.+)", line).groups()
                local[name] = self._value(first, local)
                loops.append((at, name, last))
                if float(local[name]) > float(self._value(last, local)):
                    at = lines.index("ENDFOR", at) + 1
                    loops.pop()
            elif line == "ENDFOR":
                begin, name, last = loops[-1]
                local[name] = f"{float(local[name]) + 1:g}"
                if float(local[name]) <= float(self._value(last, local)):
                    at = begin
                else:
                    loops.pop()
            elif line.startswith("WRITE("):
                fault, name, said = line[6:-1].split(",", 2)
                there = self.files.setdefault(local[name], [])
                full = len(there) >= self.largest_lines
                local[fault] = "10" if full else "0"
                if not full:
                    there.append(self._text(said, local))
            elif line.startswith("DELETE("):
                fault, name = line[7:-1].split(",")
                local[fault] = "0" if self.files.pop(local[name], None) is not None else "13"
            elif line.startswith("MSG("):
                self.shown.append(line[5:-2])
            elif match := _SET.match(line):
                self._set(match[1], match[2], local)

    def read_out(self) -> str:
        """Return the file that reading back left."""
        (lines,) = self.files.values()
        return "\n".join([*lines, ""])

    def _set(self, name: str, value: str, local: dict[str, str]) -> None:
        if not name.startswith("$"):
            local[name] = (
                value.strip('"') if value.startswith('"') else self._value(value, local)
            )
            return
        place = self._indexed(name, local)
        switch = {
            "$AN_CEC": "$SN_CEC_TABLE_ENABLE[{}]",
            "$AA_ENC": "$MA_ENC_COMP_ENABLE[{}]",
        }.get(place[:7])
        if switch is not None:
            index = place[place.index("[") + 1 : -1].split(",")
            key = f"{index[0]},{index[-1]}" if place.startswith("$AA") else index[0]
            assert self.held.get(switch.format(key), "0") == "0", (
                f"{place} written while its table acts"
            )
        self.held[place] = {"TRUE": "1", "FALSE": "0"}.get(
            value, value if value.startswith("(") else self._value(value, local)
        )

    def _indexed(self, name: str, local: Mapping[str, str]) -> str:
        head, _, index = name.partition("[")
        return f"{head}[{','.join(local.get(part, part) for part in index[:-1].split(','))}]"

    def _value(self, text: str, local: Mapping[str, str]) -> str:
        """Return a number as text: a constant, a variable, or one of them less 1."""
        if text.endswith("-1") and len(text) > 2:
            return f"{float(self._value(text[:-2], local)) - 1:g}"
        if text.startswith("$"):
            place = self._indexed(text, local)
            return self.held.get(place, self.machine.get(place.partition("[")[0], "0"))
        return local.get(text, text)

    def _text(self, words: str, local: Mapping[str, str]) -> str:
        """Return what "<<" joins: quoted words, and numbers without trailing zeros."""
        said = ""
        for part in words.split("<<"):
            if part.startswith('"'):
                said += part.strip('"')
            else:
                said += f"{float(self._value(part, local)):.10g}"
        return said


def _number(text: str) -> float | str:
    """Return a value that a condition compares: a number, or the name of an axis."""
    name = text.strip("()")
    return name if name[:1].isalpha() else float(text)
