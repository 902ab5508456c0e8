"""Tables are spoiled in every way in which they are wrong in practice: none passes, and a repeated
survey refuses few right ones."""

from testkit.rates.wrong_tables import counted


def test_no_spoiled_table_is_taken_for_right() -> None:
    """Three drawn machines with nine tables each: of all 230 mutants at most 1 % pass, none with
    its sign turned, swapped or left out."""
    refused, found = counted(3)
    assert refused <= 1
    tried = {kind: one.tried for kind, one in found.items()}
    assert sum(tried.values()) > 200
    assert sum(one.passed for one in found.values()) <= 2
    assert [
        found[kind].passed
        for kind in ("turned", "swapped", "scaled by 10", "zeros", "missing")
    ] == [0] * 5
    assert found["turned"].codes == {"sign-turned": tried["turned"]}
    assert found["scaled by 10"].codes == {"scaled": tried["scaled by 10"]}
    assert found["missing"].codes == {"missing": tried["missing"]}


def test_no_spoiled_product_is_taken_for_right() -> None:
    """Three drawn machines whose axes turn, with six products each: a product of zeros is the only
    mutant that may be loaded, because a control need not hold the products."""
    refused, found = counted(3, turning=True)
    assert refused <= 1
    tried = {kind: one.tried for kind, one in found.items()}
    assert sum(tried.values()) > 100
    assert [kind for kind, one in found.items() if one.passed] == ["zeros"]
    for kind in ("turned", "lever turned"):
        assert found[kind].codes == {"sign-turned": tried[kind]}
    assert found["scaled by 10"].codes == {"scaled": tried["scaled by 10"]}
    assert found["zeros"].codes == {"empty": tried["zeros"]}
