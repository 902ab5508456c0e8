"""The ports that a process and its descendants listen on, as the kernel lists them."""

from pathlib import Path

LISTENS, UNCONNECTED = "0A", "07"


def descendants(pid: int) -> set[int]:
    """Return a process and every process below it."""
    parents = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            parents[int(stat.parent.name)] = int(
                stat.read_text().rpartition(")")[2].split()[1]
            )
        except OSError:
            continue
    found = {pid}
    while more := {each for each, parent in parents.items() if parent in found} - found:
        found |= more
    return found


def listening(pid: int) -> set[tuple[str, int]]:
    """Return (protocol, port) of every port that a process or a descendant of it listens on; UDP:
    has bound."""
    inodes = set()
    for each in descendants(pid):
        try:
            links = [str(link.readlink()) for link in Path(f"/proc/{each}/fd").iterdir()]
        except OSError:
            continue
        inodes |= {link[8:-1] for link in links if link.startswith("socket:[")}
    found = set()
    for protocol, state in (
        ("tcp", LISTENS),
        ("tcp6", LISTENS),
        ("udp", UNCONNECTED),
        ("udp6", UNCONNECTED),
    ):
        for line in Path(f"/proc/net/{protocol}").read_text().splitlines()[1:]:
            columns = line.split()
            if columns[3] == state and columns[9] in inodes:
                found.add((protocol, int(columns[1].rpartition(":")[2], 16)))
    return found
