"""A module per group of commands; each offers ``register(app)``. Heavy imports stay inside the
functions.
"""

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
"""The groups, in the order in which the help shows them."""

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
"""Commands that use ports or a recorder, or that confine services open to the network: they need
functions that only Linux has.
"""
