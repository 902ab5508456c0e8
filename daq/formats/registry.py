"""Wire formats by name."""

from daq.formats.fourdof import FourdofDecoder, FourdofSettings
from daq.formats.line import LineDecoder, LineSettings
from daq.formats.nd import NdDecoder, NdSettings
from daq.formats.tqd import TqdDecoder, TqdSettings
from daq.formats.umd import UmdDecoder, UmdSettings
from daq.samples import Decoder
from solver.errors import UsageError

FormatSettings = UmdSettings | LineSettings | NdSettings | FourdofSettings | TqdSettings

LASER_FORMATS = ("umd", "nd", "line")
HEAD_FORMATS = ("fourdof", "tqd")


def make_decoder(name: str, settings: FormatSettings) -> Decoder:
    """Return a fresh decoder of format ``name``: one object a stream.

    Raises UsageError for a name that is none of the formats, or settings of another format.
    """
    match name, settings:
        case "umd", UmdSettings():
            return UmdDecoder(settings)
        case "line", LineSettings():
            return LineDecoder(settings)
        case "nd", NdSettings():
            return NdDecoder(settings)
        case "fourdof", FourdofSettings():
            return FourdofDecoder(settings)
        case "tqd", TqdSettings():
            return TqdDecoder(settings)
    known = ", ".join((*LASER_FORMATS, *HEAD_FORMATS))
    raise UsageError("survey: format", expected=f"one of {known} with its own settings", found=f"{name!r} with {type(settings).__name__}")
