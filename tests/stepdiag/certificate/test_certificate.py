"""The certificate against PTB's schema, and every value of it read back by a reader that shares no
code with the writer."""

import hashlib
import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from lxml import etree

from stepdiag.base.conformity import with_tolerance
from stepdiag.base.errors import DataError, UsageError
from stepdiag.base.result.result import DISPLACEMENTS, Result, parse_result
from stepdiag.certificate.document import certificate_of
from stepdiag.certificate.elements import document
from stepdiag.certificate.figures import figures_of, written
from stepdiag.report.laboratory import read_laboratory
from stepdiag.solver.methods.solve import solve
from testkit.exact.surveys import DIAGONALS, Bench, solved

SCHEMAS = Path(__file__).parents[2] / "data" / "dcc"
NAMES = {"dcc": "https://ptb.de/dcc", "si": "https://ptb.de/si"}
IN_SI = {"um": 1e-6, "urad": 1e-6, "um/m": 1e-6}
UNITS = {"um": "\\metre", "urad": "\\radian", "um/m": "\\one"}
CUSTODY = (("result", "result.json", "a" * 64), ("log", "0001.mcap", "b" * 64))
DATES = "[certificate]\nbegun = 2026-05-30\nended = 2026-05-31\n"
WHOLE = (
    DATES
    + """number = "2026-0042"
order = "A 17"
country = "DE"
issued = 2026-06-01
previous_number = "2025-0001"
previous_file = "previous.xml"
replaces = "2026-0041"
[laboratory]
name = "Messlabor & Söhne <GmbH>"
code = "D-K-00000"
city = "Musterstadt"
country = "DE"
[customer]
name = "Works"
[item]
name = "Mill 7"
serial = "4711"
[[person]]
name = "M. Mustermann"
role = "head of the laboratory"
main_signer = true
[[equipment]]
name = "laser"
serial = "L-17"
certificate = "D-K-1 2026"
certificate_file = "laser.pdf"
"""
)
TOLERANCE = {
    "volumetric_rms_um": 9.0,
    "volumetric_largest_um": 60.0,
    "squareness_urad": 20.0,
    "EYX": 9.0,
}

STATUSES = {
    "conform": ("pass",),
    "not_conform": ("fail",),
    "not_decidable": ("conditionalPass", "conditionalFail"),
}


@cache
def schema():
    return etree.XMLSchema(etree.parse(SCHEMAS / "v3.3.0" / "dcc.xsd"))


def stated(tmp_path: Path, text: str = DATES):
    (tmp_path / "laser.pdf").write_bytes(b"certificate of the laser")
    (tmp_path / "previous.xml").write_bytes(b"the report before")
    (tmp_path / "laboratory.toml").write_text(text, encoding="utf-8")
    return read_laboratory(tmp_path / "laboratory.toml")


@cache
def judged() -> Result:
    return parse_result(with_tolerance(solved(1), TOLERANCE).to_json())


@cache
def diagonals_alone() -> Result:
    return parse_result(solve(Bench(seed=2, increments=4).survey(DIAGONALS)).to_json())


@cache
def one_axis() -> Result:
    return parse_result(
        solve(Bench(seed=2, increments=4).survey(("linear-x",), passes=(1, 2))).to_json()
    )


def tree(result: Result, tmp_path: Path, text: str = DATES, **more):
    made = document(certificate_of(result, stated(tmp_path, text), CUSTODY, **more))
    found = etree.fromstring(made)
    assert schema().validate(found), schema().error_log
    return found


@pytest.mark.parametrize("result", [judged, diagonals_alone, one_axis])
@pytest.mark.parametrize("text", [DATES, WHOLE])
def test_certificate_is_valid_by_the_schema(result, text, tmp_path):
    tree(
        result(),
        tmp_path,
        text,
        left=result(),
        accepted=["ppp/1/5: beam-lost; M. Muster: seen and right"],
    )


def test_schema_accepts_the_example_and_refuses_a_certificate_without_laboratory(tmp_path):
    assert schema().validate(etree.parse(SCHEMAS / "example-valid-3.3.0.xml"))
    found = tree(judged(), tmp_path)
    laboratory = found.find(".//dcc:calibrationLaboratory", NAMES)
    laboratory.getparent().remove(laboratory)
    assert not schema().validate(found)


def quantities(found, state="as_found"):
    """Return value, U, k and unit in SI by name, and the positions of functions: read by paths of
    the schema alone."""
    read = {}
    for result in found.iterfind(
        f".//dcc:measurementResult[@refType='machineTool_{state}']/dcc:results/dcc:result",
        NAMES,
    ):
        for quantity in result.iterfind(".//dcc:quantity", NAMES):
            name = quantity.findtext("dcc:name/dcc:content", namespaces=NAMES)
            single, many = (
                quantity.find("si:real", NAMES),
                quantity.find("si:realListXMLList", NAMES),
            )
            ending = "" if many is None else "XMLList"
            inside = single if many is None else many

            def numbers(what, inside=inside):
                text = inside.findtext(f".//si:{what}", namespaces=NAMES)
                return None if text is None else [float(each) for each in text.split()]

            label = result.findtext("dcc:name/dcc:content", namespaces=NAMES)
            read[label if name != "position" else f"{label} position"] = {
                "value": numbers(f"value{ending}"),
                "unit": inside.findtext(f"si:unit{ending}", namespaces=NAMES),
                "U": numbers(f"valueExpandedMU{ending}"),
                "k": numbers(f"coverageFactor{ending}"),
            }
    return read


@pytest.mark.parametrize("result", [judged, diagonals_alone, one_axis])
def test_every_value_reads_back_in_si(result, tmp_path):
    """Functions, squareness, scales, ISO 230-2 figures and the volume: value, U = 2 u, k = 2 and
    unit to 1e-9."""
    found, count = quantities(tree(result(), tmp_path)), 0

    def agrees(name, value, u, unit):
        read = found.pop(name)
        assert read["unit"] == UNITS[unit]
        assert read["value"] == pytest.approx(
            [each * IN_SI[unit] for each in value], rel=1e-9, abs=1e-18
        )
        if u is not None:
            assert read["U"] == pytest.approx(
                [2.0 * each * IN_SI[unit] for each in u], rel=1e-9, abs=1e-18
            )
            assert read["k"] == [2.0]
        return 1

    for prefix, functions in (("", result().errors), ("reversal ", result().reversal)):
        for name, function in functions.items():
            if function.value is not None:
                at = found.pop(f"{prefix}{name} position")
                assert at["unit"] == "\\metre"
                assert at["value"] == pytest.approx(
                    [each * 1e-3 for each in function.position_mm], rel=1e-9, abs=1e-15
                )
                count += agrees(prefix + name, function.value, function.u, function.unit)
    for name in [name for name in found if name.startswith("squareness ")]:
        together = [result().squareness[each] for each in name.split()[1:]]
        count += agrees(
            name, [one.value for one in together], [one.u for one in together], "urad"
        )
    for name, number in result().squareness.items():
        count += (
            0 if number.value is None else agrees(name, [number.value], [number.u], "urad")
        )
    for axis, scale in result().scale.items():
        count += (
            0
            if scale.value is None
            else agrees(f"scale {axis}", [scale.value], [scale.u], "um/m")
        )
    for run, figures in (result().standards or {}).items():
        for symbol in [name for name in found if name.startswith(f"{run} ")]:
            value = getattr(figures[0], symbol.removeprefix(f"{run} "))
            expanded = (figures[0].U or {}).get(symbol.removeprefix(f"{run} "))
            count += agrees(
                symbol, [value], None if expanded is None else [expanded / 2.0], "um"
            )
    if result().predicted is not None:
        before = result().predicted.without_rigid_motion["before"]
        for name, interval in (
            ("volumetric rms", before.rms_um),
            ("volumetric largest", before.largest_um),
        ):
            for end, value in (
                ("", interval.value_um),
                (" low", interval.low_um),
                (" high", interval.high_um),
            ):
                count += agrees(name + end, [value], None, "um")
    assert found == {}, "every figure of the certificate stands in the result"
    assert count >= 3


def test_covariance_is_that_of_machines_drawn_from_the_posterior(tmp_path):
    """Read by paths of the schema: its diagonal is U / 2 squared, its correlations are those of
    2,000 drawn machines."""
    found, result, read = tree(judged(), tmp_path), judged(), {}
    for one in found.iterfind(
        ".//dcc:measurementResult[@refType='machineTool_as_found']/dcc:results/dcc:result",
        NAMES,
    ):
        columns = one.findall(".//si:columnXMLList/si:covarianceXMLList", NAMES)
        if columns:
            matrix = np.array(
                [
                    [
                        float(each)
                        for each in column.findtext(
                            "si:valueXMLList", namespaces=NAMES
                        ).split()
                    ]
                    for column in columns
                ]
            )
            (unit,) = {
                column.findtext("si:unitXMLList", namespaces=NAMES) for column in columns
            }
            read[one.findtext("dcc:name/dcc:content", namespaces=NAMES)] = (matrix, unit)
    assert set(read) == {"squareness C0Y B0Z A0Z", *DISPLACEMENTS}
    drawn = {
        name: result.posterior.drawn(2000) @ deviations
        for name, deviations in result.posterior.deviations().items()
    }
    for name, (matrix, unit) in read.items():
        names = name.split()[1:] or [name]
        u = np.concatenate(
            [
                np.atleast_1d(
                    result.squareness[each].u if len(names) > 1 else result.errors[each].u
                )
                for each in names
            ]
        )
        assert unit == ("\\radian" if len(names) > 1 else "\\metre") + "\\tothe{2}"
        assert np.diag(matrix) == pytest.approx((u * 1e-6) ** 2, abs=1e-17)
        assert np.array_equal(matrix, matrix.T)
        assert np.linalg.eigvalsh(matrix).min() > -1e-15
        moving = u > 1e-6
        own = (matrix / np.outer(u, u).clip(1e-12) * 1e12)[np.ix_(moving, moving)]
        assert (
            np.abs(
                own - np.corrcoef(np.hstack([drawn[each] for each in names])[:, moving].T)
            ).max()
            < 0.15
        )


@pytest.mark.parametrize("result", [judged, diagonals_alone, one_axis])
def test_what_is_null_is_not_in_it(result, tmp_path):
    text = document(certificate_of(result(), stated(tmp_path), CUSTODY)).decode()
    assert not re.search(r"\b(nan|none|null|inf)\b", text, flags=re.IGNORECASE)
    known = {figure.name for figure in figures_of(result())}
    assert {
        name for name, function in result().errors.items() if function.value is None
    }.isdisjoint(known)
    assert known.isdisjoint(
        {f"scale {axis}" for axis, scale in result().scale.items() if scale.value is None}
    )


def test_missing_statements_are_named(tmp_path):
    found = tree(judged(), tmp_path)
    for path in (
        "calibrationLaboratory/dcc:contact/dcc:name",
        "respPerson/dcc:person/dcc:name",
        "customer/dcc:name",
        "item/dcc:name",
    ):
        assert found.findtext(f".//dcc:{path}/dcc:content", namespaces=NAMES) == "not stated"
    assert {
        one.text for one in found.iterfind(".//dcc:item//dcc:identification/dcc:value", NAMES)
    } == {"not stated"}
    assert (
        found.findtext(
            ".//dcc:measuringEquipment/dcc:certificate/dcc:value", namespaces=NAMES
        )
        == "not stated"
    )


def test_statements_of_persons_and_hashes_stand_in_it(tmp_path):
    found = tree(judged(), tmp_path, WHOLE, accepted=["ppp/1/5: beam-lost; M. Muster: seen"])
    laser, before = (
        hashlib.sha256(data).hexdigest()
        for data in (b"certificate of the laser", b"the report before")
    )
    assert (
        found.findtext(
            ".//dcc:measuringEquipment/dcc:certificate/dcc:value", namespaces=NAMES
        )
        == laser
    )
    assert found.findtext(".//dcc:previousReport/dcc:value", namespaces=NAMES) == before
    assert (
        found.findtext(
            ".//dcc:reportAmendedSubstituted/dcc:replacedUniqueIdentifier", namespaces=NAMES
        )
        == "2026-0041"
    )
    assert (
        found.findtext(".//dcc:contact/dcc:name/dcc:content", namespaces=NAMES)
        == "Messlabor & Söhne <GmbH>"
    )
    assert "ppp/1/5: beam-lost; M. Muster: seen" in [
        one.text for one in found.iter(f"{{{NAMES['dcc']}}}content")
    ]
    hashes = [
        one.text
        for one in found.iterfind(
            ".//dcc:metaData[@refType='stepdiag_custody']//dcc:noQuantity/dcc:content", NAMES
        )
    ]
    assert hashes == ["a" * 64, "b" * 64]


def test_statements_of_conformity_are_those_of_the_result(tmp_path):
    found = tree(judged(), tmp_path)
    statements = found.findall(".//dcc:statement[@refType='basic_conformity']", NAMES)
    read = [one.findtext("dcc:conformity", namespaces=NAMES) for one in statements]
    conformity = judged().conformity
    assert len(read) == len(conformity.as_found) + len(conformity.predicted)
    for status, one in zip(read, conformity.as_found, strict=False):
        assert (
            status
            in {
                "conform": ("pass",),
                "not_conform": ("fail",),
                "not_decidable": ("conditionalPass", "conditionalFail"),
            }[one.verdict]
        )
    assert tree(diagonals_alone(), tmp_path).find(".//dcc:statement", NAMES) is None, (
        "without a tolerance there is no word of it"
    )


def test_days_must_be_known(tmp_path):
    with pytest.raises(DataError, match='"begun" and "ended"'):
        certificate_of(judged(), stated(tmp_path, ""), CUSTODY)


@pytest.mark.parametrize(
    "text",
    [
        "[laboratory]\nnam = 'x'\n",
        "[certificate]\ncountry = 'Germany'\n",
        "[[equipment]]\nname='l'\ncertificate_file='no.pdf'\n",
    ],
)
def test_wrong_laboratory_file_is_refused(text, tmp_path):
    with pytest.raises(UsageError):
        stated(tmp_path, text)


@pytest.mark.parametrize(
    ("value", "power", "text"),
    [
        (0.0, -6, "0"),
        (-0.0, -6, "0"),
        (12.5, -6, "0.0000125"),
        (-0.3, -6, "-3E-7"),
        (2.0, 0, "2"),
    ],
)
def test_numbers_are_exact_and_in_the_form_of_the_schema(value, power, text):
    assert written(value, power) == text
    assert float(text) == pytest.approx(value * 10.0**power, rel=1e-15, abs=0)


def test_same_result_gives_the_same_bytes(tmp_path):
    one = document(certificate_of(judged(), stated(tmp_path, WHOLE), CUSTODY))
    assert one == document(
        certificate_of(replace(judged()), stated(tmp_path, WHOLE), CUSTODY)
    )
