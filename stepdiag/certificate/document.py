"""From a result to its certificate (DCC 3.3.0 of PTB). Null values of the result are left out; a
missing fact appears as "not stated".

The DCC schema has no vocabulary for geometric errors. ``machineTool_EXX`` and similar names are ISO
230-1 symbols that the document defines.
"""

from collections.abc import Callable, Iterator, Sequence
from datetime import date
from xml.etree import ElementTree as ET

from stepdiag.base.compensation import stated_in
from stepdiag.base.errors import DataError
from stepdiag.base.messages import message
from stepdiag.base.result.members import Conformity, Facts, Judged
from stepdiag.base.result.result import Result
from stepdiag.base.result.typed import written as json_of
from stepdiag.certificate.elements import (
    VERSION,
    Words,
    data,
    element,
    note,
    real,
    sha256,
    words,
)
from stepdiag.certificate.figures import (
    KELVIN,
    UNITS,
    Figure,
    figures_of,
    predicted_figures,
    written,
)
from stepdiag.comparing.compare import require_alike, require_same_volume
from stepdiag.conclusion import judged_in, quantity_words, verdict_words
from stepdiag.report.laboratory import NOT_STATED, UNKNOWN_COUNTRY, Equipment, Place, Stated
from stepdiag.texts import LANGUAGES, catalogue

Link = tuple[str, str, str]
"""A source of a certificate: its role, its name and its SHA-256."""
CONDITIONS = {
    "air_temperature_c": ("basic_temperature", "c"),
    "material_temperature_c": ("machineTool_materialTemperature", "c"),
    "air_pressure_hpa": ("basic_pressure", "hpa"),
    "relative_humidity_percent": ("basic_humidityRelative", "percent"),
}
METHODS = (
    (
        "sequential step diagonal (laser vector) and linear runs",
        ("ISO 230-1:2012", "ISO 230-2:2014", "ISO 230-6:2002"),
    ),
    (
        (
            "expanded uncertainty, k = 2, a coverage probability of about 95 % for a normal "
            "distribution"
        ),
        ("JCGM 100:2008", "ISO/TR 230-9:2005"),
    ),
)
CONFORMITY = (
    "statement of conformity with a guard band of U (k = 2)",
    ("ISO 14253-1:2017", "JCGM 106:2012"),
)


def _words_of(key: str) -> Words:
    return {language: catalogue("report", language)[key] for language in LANGUAGES}


def certificate_of(
    result: Result,
    stated: Stated,
    custody: Sequence[Link],
    *,
    left: Result | None = None,
    accepted: Sequence[str] = (),
) -> ET.Element:
    """Return the certificate of a result.

    ``custody`` contains every source with its SHA-256, ``left`` is the result after loading,
    ``accepted`` are the accepted findings with the accepting person and the reason. Raises
    DataError if the time of the measurement, which the schema requires, is missing in the result
    and in the laboratory's file, or if ``left`` has another machine, another volume or an earlier
    day.
    """
    if left is not None:
        _require_later(result, left)
    return element(
        "digitalCalibrationCertificate",
        _administrative(result, stated, custody, left),
        _measured(result, stated, custody, left, accepted),
        schemaVersion=VERSION,
    )


def _require_later(found: Result, left: Result) -> None:
    require_alike(found, left)
    require_same_volume(found, left)
    before, after = (
        (each.survey or Facts()).ended or (each.survey or Facts()).date
        for each in (found, left)
    )
    if before and after and after < before:
        raise DataError(
            left.source, expected=message("survey-after", day=before), found=after
        )


def _administrative(
    result: Result, stated: Stated, custody: Sequence[Link], left: Result | None
) -> ET.Element:
    file = stated.file
    persons = [
        element(
            "respPerson",
            element("person", words("name", one.name or NOT_STATED)),
            element("role", text=one.role or NOT_STATED),
            element("mainSigner", text="true") if one.main_signer else None,
        )
        for one in file.person
    ]
    of_states = [
        ("as_found", judged_in(result)),
        ("as_left", None if left is None else judged_in(left)),
    ]
    statements = [
        _statement(one, state)
        for state, judged in of_states
        if judged is not None
        for one in judged.as_found
    ]
    statements += [
        _statement(one, "predicted")
        for one in (judged_in(result) or Conformity(as_found=(), predicted=())).predicted
    ]
    symbols = element(
        "refTypeDefinition",
        words("name", "machineTool"),
        words("description", "symbols of ISO 230-1 and ISO 230-2"),
        element("namespace", text="machineTool"),
        element("link", text="urn:iso:std:iso:230:-1"),
    )
    return element(
        "administrativeData",
        element("dccSoftware", _software(result)),
        element("refTypeDefinitions", symbols),
        _core(result, stated, custody),
        element("items", _item(result, stated)),
        element(
            "calibrationLaboratory",
            element("calibrationLaboratoryCode", text=file.laboratory.code or NOT_STATED),
            _contact("contact", file.laboratory),
        ),
        element(
            "respPersons",
            *(
                persons
                or [element("respPerson", element("person", words("name", NOT_STATED)))]
            ),
        ),
        _contact("customer", file.customer, (result.survey or Facts()).customer),
        element("statements", *statements) if statements else None,
    )


def _software(result: Result) -> ET.Element:
    name, version = result.software.name or "stepdiag", result.software.version
    return element(
        "software", words("name", name), element("release", text=version or NOT_STATED)
    )


def _core(result: Result, stated: Stated, custody: Sequence[Link]) -> ET.Element:
    head, facts = stated.file.certificate, result.survey or Facts()
    begun, ended = (
        head.begun or _day(facts.begun or facts.date),
        head.ended or _day(facts.ended or facts.date),
    )
    if begun is None or ended is None:
        raise DataError(
            stated.name or result.source,
            expected=message("certificate-dates"),
            found=message("nothing"),
            remedy=message("certificate-state-dates"),
        )
    result_hash = next(digest for role, _, digest in custody if role == "result")
    previous = stated.hashes.get(head.previous_file, "")
    replaced = element("replacedUniqueIdentifier", text=head.replaces)
    amended = element(
        "reportAmendedSubstituted", element("typeOfChange", text="amended"), replaced
    )
    return element(
        "coreData",
        element("countryCodeISO3166_1", text=head.country or UNKNOWN_COUNTRY),
        *(element("usedLangCodeISO639_1", text=language) for language in LANGUAGES),
        element("mandatoryLangCodeISO639_1", text=LANGUAGES[0]),
        element("uniqueIdentifier", text=head.number or f"stepdiag-{result_hash}"),
        element("identifications", _identity("calibrationLaboratory", head.order, "order")),
        element("beginPerformanceDate", text=begun.isoformat()),
        element("endPerformanceDate", text=ended.isoformat()),
        element("performanceLocation", text=head.location),
        element("issueDate", text=head.issued.isoformat())
        if head.issued is not None
        else None,
        amended if head.replaces else None,
        sha256(
            "previousReport", head.previous_file, head.previous_number or NOT_STATED, previous
        )
        if previous
        else None,
    )


def _day(text: str) -> date | None:
    try:
        return date.fromisoformat(text[:10])
    except ValueError:
        return None


def _identity(issuer: str, value: str, name: str) -> ET.Element:
    return element(
        "identification",
        element("issuer", text=issuer),
        element("value", text=value or NOT_STATED),
        words("name", name),
    )


def _item(result: Result, stated: Stated) -> ET.Element:
    item, facts = stated.file.item, result.survey or Facts()
    return element(
        "item",
        words("name", item.name or facts.machine or NOT_STATED),
        element("manufacturer", words("name", item.manufacturer or NOT_STATED)),
        element("model", text=item.model or NOT_STATED),
        element(
            "identifications",
            _identity("manufacturer", item.serial or facts.machine_serial, "serial number"),
            _identity("customer", item.inventory, "inventory number"),
        ),
    )


def _contact(name: str, place: Place, known: str = "") -> ET.Element:
    where = {
        "city": place.city or NOT_STATED,
        "countryCode": place.country or UNKNOWN_COUNTRY,
        "postCode": place.post_code or NOT_STATED,
        "street": place.street or NOT_STATED,
        "streetNo": place.street_no or NOT_STATED,
    }
    return element(
        name,
        words("name", place.name or known or NOT_STATED),
        element("eMail", text=place.email or NOT_STATED),
        element("phone", text=place.phone or NOT_STATED),
        element("location", *(element(part, text=text) for part, text in where.items())),
    )


def _statement(one: Judged, state: str) -> ET.Element:
    """Return the statement of conformity about one value. If the interval of a value contains the
    limit, the verdict is conditional (ILAC-G8): a conditional pass for a value within the limit,
    otherwise a conditional fail."""
    name = {
        language: f"{catalogue('report', language)[state]}: {quantity_words(one, language)}"
        for language in LANGUAGES
    }
    declared: Words = {language: verdict_words(one, language) for language in LANGUAGES}
    ends = {"tolerance": one.tolerance, "value": one.value, "low": one.low, "high": one.high}
    unit, power = UNITS[one.unit]
    known = [
        Figure(part, f"machineTool_{part}", unit, (written(value, power),))
        for part, value in ends.items()
        if value is not None
    ]
    if one.probability is not None:
        known.append(
            Figure(
                "probability of conformity",
                "machineTool_probabilityOfConformity",
                r"\one",
                (written(one.probability, 0),),
            )
        )
    return element(
        "statement",
        words("name", name),
        *(element("norm", text=norm) for norm in CONFORMITY[1]),
        words("declaration", declared),
        element("conformity", text=_status(one)) if one.value is not None else None,
        element("data", *map(real, known)),
        refType="basic_conformity",
    )


def _status(one: Judged) -> str:
    undecided = (
        "conditionalPass" if abs(one.value or 0.0) <= one.tolerance else "conditionalFail"
    )
    return {"conform": "pass", "not_conform": "fail", "not_decidable": undecided}[one.verdict]


def _measured(
    result: Result,
    stated: Stated,
    custody: Sequence[Link],
    left: Result | None,
    accepted: Sequence[str],
) -> ET.Element:
    methods = [*METHODS, *([CONFORMITY] if result.conformity is not None else [])]
    used = [
        element(
            "usedMethod", words("name", name), *(element("norm", text=norm) for norm in norms)
        )
        for name, norms in methods
    ]
    return element(
        "measurementResults",
        element("usedMethods", *used),
        element("usedSoftware", _software(result)),
        element("measuringEquipments", *_equipment(result, stated)),
        element(
            "measurementMetaData", _chain(result), *_custody(custody), *_accepted(accepted)
        ),
        _state("as_found", result, figures_of),
        _state("predicted", result, predicted_figures),
        None if left is None else _state("as_left", left, figures_of),
    )


def _state(
    state: str, result: Result, figures: Callable[[Result], Iterator[Figure]]
) -> ET.Element | None:
    results = [
        element("result", words("name", figure.name), data(figure), refType=figure.refers)
        for figure in figures(result)
    ]
    if not results:
        return None
    conditions = list(_conditions(result)) if state != "predicted" else []
    return element(
        "measurementResult",
        words("name", _words_of(state)),
        words(
            "description",
            f"method {result.method}; error = actual - commanded, of the tool relative to the "
            "workpiece",
        ),
        element("influenceConditions", *conditions) if conditions else None,
        element("results", *results),
        refType=f"machineTool_{state}",
    )


def _conditions(result: Result) -> Iterator[ET.Element]:
    seen = {} if result.conditions is None else json_of(result.conditions)
    for name, (refers, unit) in CONDITIONS.items():
        if name in seen:
            ends = [
                Figure(end, f"{refers}{end.title()}", *_in_si(value, unit))
                for end, value in zip(("min", "max"), seen[name], strict=True)
            ]
            yield element(
                "influenceCondition",
                words("name", name),
                element("data", *map(real, ends)),
                refType=refers,
            )
    statement = stated_in(result).words()
    yield element(
        "influenceCondition",
        words("name", _words_of("compensation")),
        element("data", note("state", statement, "machineTool_compensationState")),
        refType="machineTool_compensation",
    )


def _in_si(value: float, unit: str) -> tuple[str, tuple[str]]:
    if unit == "c":
        return KELVIN, (written(round(value + 273.15, 6), 0),)
    unit_si, power = UNITS[unit]
    return unit_si, (written(value, power),)


def _equipment(result: Result, stated: Stated) -> Iterator[ET.Element]:
    facts = result.survey or Facts()
    laser = Equipment(
        name=facts.instrument or "laser",
        serial=facts.instrument_serial,
        certificate=facts.instrument_certificate,
    )
    sensors = [Equipment(name=facts.sensors)] if facts.sensors else []
    for one in stated.file.equipment or (laser, *sensors):
        digest = stated.hashes.get(one.certificate_file, NOT_STATED)
        yield element(
            "measuringEquipment",
            words("name", one.name),
            sha256(
                "certificate",
                one.certificate_file or NOT_STATED,
                one.certificate or NOT_STATED,
                digest,
            ),
            element("manufacturer", words("name", one.manufacturer or NOT_STATED)),
            element("model", text=one.model or NOT_STATED),
            element(
                "identifications", _identity("manufacturer", one.serial, "serial number")
            ),
        )


def _chain(result: Result) -> ET.Element:
    volume = result.volume
    box = zip("XYZ", volume.origin_mm, volume.size_mm, strict=True)
    sides = [
        Figure(f"{what} {axis}", f"machineTool_{what}{axis}", *_in_si(value, "mm"))
        for axis, low, size in box
        for what, value in (("origin", low), ("size", size))
    ]
    return element(
        "metaData",
        words("name", _words_of("chain")),
        element("data", note("chain", result.chain, "machineTool_chain"), *map(real, sides)),
        refType="machineTool_chain",
    )


def _custody(custody: Sequence[Link]) -> Iterator[ET.Element]:
    notes = [note(name, digest, f"stepdiag_{role}") for role, name, digest in custody]
    yield element(
        "metaData",
        words("name", "SHA-256"),
        element("data", *notes),
        refType="stepdiag_custody",
    )


def _accepted(accepted: Sequence[str]) -> Iterator[ET.Element]:
    if accepted:
        notes = [
            note(f"{number}", text, "stepdiag_acceptedFinding")
            for number, text in enumerate(accepted, start=1)
        ]
        yield element(
            "metaData",
            words("name", "accepted findings"),
            element("data", *notes),
            refType="stepdiag_accepted",
        )
