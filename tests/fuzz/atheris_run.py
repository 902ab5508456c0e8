"""``python tests/fuzz/atheris_run.py TARGET [libFuzzer options]``: coverage-guided fuzzing of one
reader (docs/security.md).

Needs the package atheris, which is not among the dependencies;
the targets are those of tests/fuzz/test_foreign_files.py, ``list`` prints them.
What it kept of a run before, in build/fuzz, is where the next one begins.
"""

import sys
import warnings
from pathlib import Path

import atheris

sys.path.insert(0, str(Path(__file__).parents[1] / "lib"))
with atheris.instrument_imports(include=["daq", "exporters", "solver"]):
    from testkit.hostile.changes import HOSTILE, TOKENS
    from testkit.hostile.foreign import targets


def main() -> None:
    """Fuzz until libFuzzer has enough, beginning with the target's good file."""
    known = targets()
    if sys.argv[1] == "list":
        print("\n".join(known))
        return
    seed, target, _ = known[sys.argv[1]]
    folder = Path("build") / "fuzz"
    corpus = folder / sys.argv[1].replace(" ", "-")
    corpus.mkdir(parents=True, exist_ok=True)
    (corpus / "seed").write_bytes(seed)
    words = folder / "words.dict"
    words.write_text(
        "".join(f'"{_escaped(word)}"\n' for word in (*HOSTILE, *TOKENS) if len(word) < 60),
        encoding="ascii",
    )
    options = [
        "-timeout=20",
        "-rss_limit_mb=2048",
        f"-max_len={4 * len(seed) + 6000}",
        f"-dict={words}",
    ]
    atheris.Setup([sys.argv[0], *options, *sys.argv[2:], str(corpus)], target)
    warnings.simplefilter("error")
    atheris.Fuzz()


def _escaped(word: bytes) -> str:
    return "".join(f"\\x{byte:02x}" for byte in word)


if __name__ == "__main__":
    main()
