"""Elements of a DCC 3.3.0 with values of D-SI 2.2.1, built with Python's standard library."""

from collections.abc import Iterable, Mapping
from statistics import NormalDist
from xml.etree import ElementTree as ET

from stepdiag.certificate.figures import METRE, Figure
from stepdiag.texts import Language

DCC, SI = "https://ptb.de/dcc", "https://ptb.de/si"
VERSION = "3.3.0"
K, P = "2", "0.95"
Words = Mapping[Language, str] | str
"""A text for all languages, or a text by language."""
ET.register_namespace("dcc", DCC)
ET.register_namespace("si", SI)


def element(
    name: str, *children: ET.Element | None, text: str | None = None, **attributes: str
) -> ET.Element:
    return _with(ET.Element(f"{{{DCC}}}{name}", attributes), children, text)


def _si(name: str, *children: ET.Element, text: str | None = None) -> ET.Element:
    return _with(ET.Element(f"{{{SI}}}{name}"), children, text)


def _with(
    made: ET.Element, children: Iterable[ET.Element | None], text: str | None
) -> ET.Element:
    made.text = text if text is None else " ".join(text.split())
    made.extend([child for child in children if child is not None])
    return made


def words(name: str, text: Words) -> ET.Element:
    if isinstance(text, str):
        return element(name, element("content", text=text))
    return element(
        name,
        *(element("content", text=each, lang=language) for language, each in text.items()),
    )


def real(figure: Figure) -> ET.Element:
    """Return the element of a quantity: a single value, or a list of values after the list of their
    positions."""
    named = [words("name", figure.name)]
    if len(figure.values) == 1 and not figure.at:
        inside = [_si("value", text=figure.values[0]), _si("unit", text=figure.unit)]
        if figure.expanded:
            expanded = [
                _si("valueExpandedMU", text=figure.expanded[0]),
                _si("coverageFactor", text=K),
                _si("coverageProbability", text=P),
            ]
            inside.append(
                _si("measurementUncertaintyUnivariate", _si("expandedMU", *expanded))
            )
        return element("quantity", *named, _si("real", *inside), refType=figure.refers)
    many = _list(figure.values, figure.unit, figure.expanded)
    if figure.covariance:
        many.append(_covariance(figure))
    return element("quantity", *named, many, refType=figure.refers)


def _covariance(figure: Figure) -> ET.Element:
    """Return the element with the covariance of a list of values and the coverage factor k of their
    rectangular coverage region. All values together are within their k u with a probability of at
    least `P`.

    Source: JCGM 102:2011, 7.7.3 (Bonferroni): k of a normal distribution for P = 1 - 0.05 / n.
    """
    columns = [_column(column, rf"{figure.unit}\tothe{{2}}") for column in figure.covariance]
    k = NormalDist().inv_cdf(1.0 - (1.0 - float(P)) / (2.0 * len(columns)))
    region = _si(
        "rectangularRegionMUXMLList",
        _si("covarianceMatrixXMLList", *columns),
        _si("coverageFactorXMLList", text=f"{k:.4f}"),
        _si("coverageProbabilityXMLList", text=P),
    )
    return _si("measurementUncertaintyMultivariateXMLList", region)


def _column(values: Iterable[str], unit: str) -> ET.Element:
    return _si(
        "columnXMLList",
        _si(
            "covarianceXMLList",
            _si("valueXMLList", text=" ".join(values)),
            _si("unitXMLList", text=unit),
        ),
    )


def _list(values: Iterable[str], unit: str, expanded: Iterable[str] = ()) -> ET.Element:
    inside, stated = (
        [_si("valueXMLList", text=" ".join(values)), _si("unitXMLList", text=unit)],
        " ".join(expanded),
    )
    if stated:
        of_all = [
            _si("valueExpandedMUXMLList", text=stated),
            _si("coverageFactorXMLList", text=K),
            _si("coverageProbabilityXMLList", text=P),
        ]
        inside.append(
            _si("measurementUncertaintyUnivariateXMLList", _si("expandedMUXMLList", *of_all))
        )
    return _si("realListXMLList", *inside)


def data(figure: Figure) -> ET.Element:
    """Return the ``data`` element of a quantity; positions come before values."""
    if not figure.at:
        return element("data", real(figure))
    positions = element(
        "quantity",
        words("name", "position"),
        _list(figure.at, METRE),
        refType="machineTool_position",
    )
    return element(
        "data", element("list", positions, real(figure), refType="basic_tableIndex0")
    )


def sha256(name: str, referral: str, identity: str, value: str) -> ET.Element:
    return element(
        name,
        words("referral", referral),
        element("referralID", text=identity),
        element("procedure", text="SHA-256"),
        element("value", text=value),
    )


def note(name: str, text: str, refers: str) -> ET.Element:
    return element("quantity", words("name", name), words("noQuantity", text), refType=refers)


def document(root: ET.Element) -> bytes:
    """Return the bytes of a certificate. The same tree gives the same bytes."""
    ET.indent(root)
    text: bytes = ET.tostring(root, encoding="utf-8", xml_declaration=True)
    return text + b"\n"
