"""What can be changed in a file: one small change at a time, by the operators of cosmic-ray and one
of ours.

Of cosmic-ray's 213 operators those are used that a person could have typed: ``+`` for ``-``, not
``+`` for ``>>``, which falls over at once and only flatters the figure. Annotations, decorators,
``frozen`` and its like of a class, and the ``strict`` of a ``zip`` declare what must hold anyway
and are left alone.
"""

import ast
import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import parso
from cosmic_ray import plugins
from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.operators.operator import Example, Operator

BINARY = {
    "Add": ["Sub"],
    "Sub": ["Add"],
    "Mul": ["Div"],
    "Div": ["Mul"],
    "FloorDiv": ["Mul"],
    "Mod": ["Mul"],
    "Pow": ["Mul"],
    "LShift": ["RShift"],
    "RShift": ["LShift"],
    "BitAnd": ["BitOr"],
    "BitOr": ["BitAnd"],
    "BitXor": ["BitAnd"],
}
BETWEEN = {
    "arith_expr",
    "term",
    "power",
    "expr",
    "and_expr",
    "xor_expr",
    "shift_expr",
    "expr_stmt",
}
COMPARISON = {
    "Eq": ["NotEq"],
    "NotEq": ["Eq"],
    "Is": ["IsNot"],
    "IsNot": ["Is"],
    "Lt": ["LtE", "GtE"],
    "LtE": ["Lt", "Gt"],
    "Gt": ["GtE", "LtE"],
    "GtE": ["Gt", "Lt"],
}
OTHERS = [
    "ReplaceUnaryOperator_USub_UAdd",
    "ReplaceUnaryOperator_Delete_Not",
    "ReplaceUnaryOperator_Delete_Invert",
    "AddNot",
    "ReplaceTrueWithFalse",
    "ReplaceFalseWithTrue",
    "ReplaceAndWithOr",
    "ReplaceOrWithAnd",
    "ReplaceBreakWithContinue",
    "ReplaceContinueWithBreak",
    "ExceptionReplacer",
    "NumberReplacer",
    "ZeroIterationForLoop",
]


class DropStatement(Operator):
    """Leaves out a call whose value nobody takes, and an augmented assignment."""

    def mutation_positions(self, node):
        first = node.children[0] if node.type == "simple_stmt" else None
        called = (
            first is not None
            and first.type in {"atom_expr", "power"}
            and first.children[-1].get_code().startswith("(")
        )
        grown = (
            first is not None
            and first.type == "expr_stmt"
            and first.children[1].type == "augassign"
        )
        if called or grown:
            yield first.start_pos, first.end_pos

    def mutate(self, node, index):
        indent = node.children[0].get_first_leaf().prefix
        node.children[0] = parso.parse(f"{indent}pass")
        return node

    @classmethod
    def examples(cls):
        return (Example("grow(3)\n", "pass\n"), Example("a += 3\n", "pass\n"))


def _operators() -> dict[str, Operator]:
    names = [
        f"ReplaceBinaryOperator_{old}_{new}" for old, news in BINARY.items() for new in news
    ]
    names += [
        f"ReplaceComparisonOperator_{old}_{new}"
        for old, news in COMPARISON.items()
        for new in news
    ]
    return {name: plugins.get_operator(f"core/{name}")() for name in names + OTHERS} | {
        "DropStatement": DropStatement()
    }


OPERATORS = _operators()


class Mutation(NamedTuple):
    """One change: where, by which operator, the how-manieth of that operator in the file, and a
    name that outlives work elsewhere in it."""

    path: str
    line: int
    operator: str
    occurrence: int
    name: str
    text: str  # the line as it stands

    def apply(self, root: Path) -> str:
        """Return the file with this change in it."""
        changed = mutate_code(
            (root / self.path).read_text(encoding="utf-8"),
            OPERATORS[self.operator],
            self.occurrence,
        )
        assert changed is not None, self
        return changed

    def rank(self, seed: int) -> str:
        """Return where this change stands in the draw with a seed."""
        return hashlib.sha256(f"{seed} {self.name}".encode()).hexdigest()


def _declared(node: ast.AST) -> list[ast.expr]:
    """Return what of a node only declares; what `Annotated` says of a value does more."""
    found = [
        *getattr(node, "decorator_list", []),
        getattr(node, "returns", None),
        getattr(node, "annotation", None),
    ]
    if isinstance(node, ast.keyword) and node.arg == "strict":
        found.append(node.value)
    if isinstance(node, ast.ClassDef):
        found += [
            option.value
            for option in node.keywords
            if option.arg in {"frozen", "kw_only", "eq", "slots", "gc"}
        ]
    return [
        one for one in found if isinstance(one, ast.expr) and "Annotated" not in ast.dump(one)
    ]


def _hidden(tree: ast.Module) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    """Return where that begins and ends."""
    found = [one for node in ast.walk(tree) for one in _declared(node)]
    return [
        ((one.lineno, one.col_offset), (one.end_lineno or 0, one.end_col_offset or 0))
        for one in found
    ]


def _typed(operator: str, node) -> bool:
    """Say whether this is the operator between two things, and not the star of a call, of a
    signature or of a display."""
    if not operator.startswith("ReplaceBinaryOperator"):
        return True
    before = node.get_previous_sibling()
    return (
        before is not None
        and before.get_code().strip() not in {",", "(", "{", "["}
        and node.parent.type in BETWEEN
    )


def mutations(root: Path, path: str) -> Iterator[Mutation]:
    """Yield every change of a file."""
    source = (root / path).read_text(encoding="utf-8")
    lines, hidden, seen = source.splitlines(), _hidden(ast.parse(source)), {}
    nodes = list(ast_nodes(get_ast(source)))
    for name, operator in OPERATORS.items():
        positions = (
            (node, start) for node in nodes for start, _ in operator.mutation_positions(node)
        )
        for occurrence, (node, start) in enumerate(positions):
            if not _typed(name, node) or any(begin <= start < end for begin, end in hidden):
                continue
            text = lines[start[0] - 1].strip()
            key = f"{path} {name} {text}"
            seen[key] = seen.get(key, 0) + 1
            yield Mutation(path, start[0], name, occurrence, f"{key} #{seen[key]}", text)


def draw(groups: dict[str, list[Mutation]], count: int, seed: int) -> list[Mutation]:
    """Return ``count`` changes (all where 0), each file by its share; the same ones for the same
    seed as long as their lines stand."""
    total = sum(map(len, groups.values()))
    if not count or count >= total:
        return [one for group in groups.values() for one in group]
    shares = {path: count * len(group) / total for path, group in groups.items()}
    taken = {path: int(share) for path, share in shares.items()}
    rest = sorted(shares, key=lambda path: (taken[path] - shares[path], path))[
        : count - sum(taken.values())
    ]
    return [
        one
        for path, group in groups.items()
        for one in sorted(group, key=lambda one: one.rank(seed))[
            : taken[path] + (path in rest)
        ]
    ]
