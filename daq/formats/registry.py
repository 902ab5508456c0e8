"""The decoders of all wire formats, by the name of the format."""

from stepdiag.base.errors import UsageError
from stepdiag.base.messages import message
from stepdiag.daq.formats.instruments.air import AirDecoder, AirSettings, AskedAirDecoder
from stepdiag.daq.formats.instruments.angles import (
    AnglesDecoder,
    AnglesSettings,
    AskedAnglesDecoder,
)
from stepdiag.daq.formats.instruments.fourdof import FourdofDecoder, FourdofSettings
from stepdiag.daq.formats.instruments.framed import FramesDecoder, FramesSettings
from stepdiag.daq.formats.instruments.ids3010 import Ids3010Decoder, Ids3010Settings
from stepdiag.daq.formats.instruments.lasertex import LasertexDecoder, LasertexSettings
from stepdiag.daq.formats.instruments.line import LineDecoder, LineSettings
from stepdiag.daq.formats.instruments.nd import NdDecoder, NdSettings
from stepdiag.daq.formats.instruments.qudis import QudisDecoder, QudisSettings
from stepdiag.daq.formats.instruments.tqd import TqdDecoder, TqdSettings
from stepdiag.daq.formats.instruments.umd.decoder import UmdDecoder, UmdSettings
from stepdiag.daq.timing.samples import Decoder

FormatSettings = (
    UmdSettings
    | LineSettings
    | FramesSettings
    | NdSettings
    | Ids3010Settings
    | LasertexSettings
    | QudisSettings
    | FourdofSettings
    | TqdSettings
    | AnglesSettings
    | AirSettings
)

LASER_FORMATS = ("umd", "nd", "line", "frames", "ids3010", "lasertex", "qudis")
HEAD_FORMATS = ("fourdof", "tqd", "elcomat", "wyler")
AIR_FORMATS = ("ptu300", "line")


def make_decoder(name: str, settings: FormatSettings) -> Decoder:  # noqa: C901, PLR0911 - one a format
    """Return a new decoder of the format ``name``. Each stream needs its own decoder.

    Raises UsageError for an unknown name, or for settings of another format.
    """
    match name, settings:
        case "umd", UmdSettings():
            return UmdDecoder(settings)
        case "line", LineSettings():
            return LineDecoder(settings)
        case "frames", FramesSettings():
            return FramesDecoder(settings)
        case "ids3010", Ids3010Settings():
            return Ids3010Decoder(settings)
        case "lasertex", LasertexSettings():
            return LasertexDecoder(settings)
        case "qudis", QudisSettings():
            return QudisDecoder(settings)
        case "nd", NdSettings():
            return NdDecoder(settings)
        case "fourdof", FourdofSettings():
            return FourdofDecoder(settings)
        case "tqd", TqdSettings():
            return TqdDecoder(settings)
        case "elcomat", AnglesSettings():
            return AnglesDecoder(settings)
        case "wyler", AnglesSettings():
            return AskedAnglesDecoder(settings)
        case _, AirSettings() if name in AIR_FORMATS:
            return AskedAirDecoder(settings) if settings.request else AirDecoder(settings)
    known = message("format-with-settings", names=[*LASER_FORMATS, *HEAD_FORMATS])
    raise UsageError(
        "survey: format", expected=known, found=f"{name!r}: {type(settings).__name__}"
    )
