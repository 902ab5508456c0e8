"""One module per group of commands, each with a function ``register(app)``. Imports that take time
are inside the functions."""

MODULES = (
    "demo",
    "survey",
    "setup",
    "check",
    "run",
    "status",
    "accept",
    "correct",
    "begin",
    "stream",
    "solve",
    "runs",
    "logs",
    "report",
    "certificate",
    "control",
    "sign_test",
    "proof",
    "program",
    "plan",
    "ahead",
    "fourdof",
    "fleet",
    "publish",
    "service",
)
"""The groups of commands in the order of the help."""

LINUX_ONLY = frozenset(
    {
        "check",
        "demo",
        "fleet",
        "proof",
        "publish",
        "run",
        "service install",
        "service publish",
        "service remove",
        "setup",
        "status",
        "stream",
    }
)
"""The commands that require Linux: they use ports or a recorder, or they confine services that are
open to the network."""
