"""A plugin of mypy: every `message("key", ...)` has a key of the catalogue, and arguments of its
names and types.

And no code of the program reads the English text of a finding, to decide by it or to show it:
`in_words` renders it for the reader, code, key and arguments tell what it is about.
"""

from collections.abc import Callable
from functools import partial

from mypy.nodes import ARG_STAR2, TypeInfo
from mypy.plugin import AttributeContext, FunctionContext, Plugin, ReportConfigContext
from mypy.subtypes import is_subtype
from mypy.types import Instance, LiteralType, Type, UnionType, get_proper_type

from stepdiag.texts.patterns import sentences, slots

TEXTS = (
    "stepdiag.base.findings.Finding.text",
    "stepdiag.daq.records.status.FindingStatus.text",
)
"""English sentences for logs, results and programs outside."""
MESSAGE = "stepdiag.base.messages.Message"
MAKERS = (
    "stepdiag.base.messages.message",
    *(f"stepdiag.base.findings.{severity}" for severity in ("error", "warning", "info")),
)
"""Functions whose first argument is a key, and whose others are the arguments of its message."""
READERS = ("stepdiag/base/findings.py", "stepdiag/daq/records/status.py")
"""Where a text is written out, and where one of an old log or result takes the place of a
message."""


class Messages(Plugin):
    """Look at the calls of the makers of messages, and at the texts that nothing reads."""

    def get_attribute_hook(self, fullname: str) -> Callable[[AttributeContext], Type] | None:
        """Return what looks at an attribute."""
        return _refuse_text if fullname in TEXTS else None

    def get_function_hook(self, fullname: str) -> Callable[[FunctionContext], Type] | None:
        """Return what looks at a call."""
        if fullname not in MAKERS:
            return None
        known = self.lookup_fully_qualified(MESSAGE)
        if known is None or not isinstance(known.node, TypeInfo):
            raise LookupError(MESSAGE)
        return partial(_check, Instance(known.node, []))

    def report_config_data(self, ctx: ReportConfigContext) -> object:
        """Return what a checked file hangs on beside its own text: the catalogue."""
        return (
            {key: sorted(slots(key).items()) for key in sorted(sentences())}
            if ctx.id.startswith("stepdiag")
            else None
        )


def _refuse_text(read: AttributeContext) -> Type:
    path = read.api.path
    if "tests/" not in path and not path.endswith(READERS):
        read.api.fail(
            "The text of a finding is for old logs and programs outside: use in_words, or its "
            "code and arguments",
            read.context,
        )
    return read.default_attr_type


def _check(words: Type, call: FunctionContext) -> Type:
    types = _expected(call, words)
    given = dict(zip(call.arg_names[1], call.arg_types[1], strict=True))
    keys = _keys(call.arg_types[0][0])
    if not keys:
        call.api.fail("The key of a message is written out", call.context)
    for key in keys:
        try:
            wanted = slots(key)
        except KeyError:
            call.api.fail(f'No message has the key "{key}"', call.context)
            continue
        if ARG_STAR2 not in call.arg_kinds[1] and given.keys() != wanted.keys():
            call.api.fail(
                f"Message {key} has the arguments {', '.join(sorted(wanted)) or 'none'}",
                call.context,
            )
        for name, kind in wanted.items():
            if name in given and not is_subtype(given[name], types[kind]):
                call.api.fail(
                    f"Message {key}: {name} is a {kind}, not {given[name]}", call.context
                )
    return call.default_return_type


def _expected(call: FunctionContext, words: Type) -> dict[str, Type]:
    of = call.api.named_generic_type
    name, whole = (
        UnionType([of("builtins.str", []), words]),
        of("builtins.int", []),
    )
    many = dict.fromkeys(
        ("list", "each", "or", "and", "ranges", "stops"),
        of("typing.Sequence", [UnionType([name, whole])]),
    )
    one = {"name": name, "setup": name, **dict.fromkeys(("whole", "stop", "pass"), whole)}
    return {**one, "number": of("builtins.float", []), **many}


def _keys(given: Type) -> list[str]:
    kind = get_proper_type(given)
    if isinstance(kind, UnionType):
        return [key for item in kind.items for key in _keys(item)]
    if isinstance(kind, Instance) and kind.last_known_value is not None:
        kind = kind.last_known_value
    return (
        [kind.value] if isinstance(kind, LiteralType) and isinstance(kind.value, str) else []
    )


def plugin(version: str) -> type[Plugin]:
    """Return the plugin, whatever mypy's version."""
    return Messages
