"""`stepdiag publish --opcua` and a client of OPC UA: what it can browse, read, call and hear of a
survey, and what it may not do."""

import asyncio
import hashlib
import json
import subprocess
import sys
from datetime import timedelta
from pathlib import Path

import pytest
from asyncua import Client, ua
from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256
from asyncua.ua.ua_binary import extensionobject_to_binary

from stepdiag.base.errors import DeviceError
from stepdiag.publish import opcua
from stepdiag.virtual.base.reserved import reserved_port
from testkit.fleets import FIRST, QUARTER, write_rounds
from testkit.running.brokers import PATIENCE_S
from testkit.running.opcua import MACHINE, MODEL, NOW, Serving, prepared, subtyped_values

pytestmark = [pytest.mark.system, pytest.mark.timeout(600)]

USER, PASSWORD = "mes", "not-to-be-guessed"
YEAR = timedelta(days=365.25)
NODE = Path(__file__).parents[1] / "node"


@pytest.fixture(scope="module")
def survey(tmp_path_factory):
    return prepared(tmp_path_factory.mktemp("survey"))


@pytest.fixture(scope="module")
def serving(survey):
    with Serving(survey, "--plain") as running:
        yield running


def asked(serving, work):
    """Return what ``work`` finds as a client that knows nothing but the standard's names."""

    async def run():
        async with Client(
            serving.url, timeout=PATIENCE_S, watchdog_intervall=PATIENCE_S
        ) as client:
            with subtyped_values():
                await client.load_data_type_definitions()
                return await work(client, *(await named(client)))

    return asyncio.run(asyncio.wait_for(run(), 4 * PATIENCE_S))


async def named(client):
    """Return the two namespaces, the machine and its management of results."""
    index = await client.get_namespace_index(MODEL)
    own = await client.get_namespace_index("urn:stepdiag:publish")
    machine = await client.nodes.objects.get_child(ua.QualifiedName(MACHINE, own))
    return index, own, machine, await machine.get_child(f"{index}:ResultManagement")


async def until(look, wanted):
    """Return what ``look`` gives once it is as wanted."""
    async with asyncio.timeout(PATIENCE_S):
        while True:
            found = await look()
            if wanted(found):
                return found
            await asyncio.sleep(0.1)


def test_results_are_read_by_variable_and_by_method(serving, survey):
    async def work(_client, index, _own, _machine, management):
        kind = await management.read_type_definition()
        variable = (await (await management.get_child(f"{index}:Results")).get_children())[-1]
        handle, latest, error = await management.call_method(f"{index}:GetLatestResult", NOW)
        name = latest.ResultMetaData.ResultId
        by_id = await management.call_method(
            f"{index}:GetResultById", ua.Variant(name, ua.VariantType.String), NOW
        )
        part = await variable.get_child([f"{index}:ResultMetaData", f"{index}:ResultId"])
        release = [
            await management.call_method(
                f"{index}:ReleaseResultHandle", ua.Variant(handle, ua.VariantType.UInt32)
            )
            for _ in range(2)
        ]
        return (
            kind,
            await variable.read_type_definition(),
            latest,
            error,
            by_id,
            await part.read_value(),
            await variable.read_value(),
            release,
        )

    kind, of_variable, latest, error, by_id, part, value, release = asked(serving, work)
    assert (kind.Identifier, of_variable.Identifier, error, by_id[2]) == (1004, 2001, 0, 0), (
        "the published ids"
    )
    meta = latest.ResultMetaData
    assert (meta.PartId, meta.JobId, meta.IsPartial, meta.HasTransferableDataOnFile) == (
        MACHINE,
        "bench",
        False,
        False,
    )
    assert meta.CreationTime == meta.ProcessingTimes.EndTime >= meta.ProcessingTimes.StartTime
    assert part == meta.ResultId
    assert by_id[1] == latest == value
    said, findings = (json.loads(each.Value) for each in latest.ResultContent)
    assert said["schema"] == "stepdiag-result"
    assert said["sha256"].startswith(meta.ResultId.rpartition("/")[2])
    assert {row["quantity"] for row in said["rows"]} >= {"EXX", "volumetric-rms"}
    found = json.loads((survey.parent / "bench/0001/result.json").read_text())["findings"]
    assert [each["code"] for each in findings["findings"]] == [each["code"] for each in found]
    assert release == [0, -1], "a handle is released once"


def test_a_client_of_another_maker_decodes_a_result_from_its_definition(serving):
    """node-opcua builds its decoders from the definitions that the server offers; asyncua alone
    would share our mistakes."""
    found = by_node(serving)
    assert found["variable"] == found["method"]
    told = found["method"]
    assert (told["type"], told["part"], told["job"]) == (
        "ResultMetaDataType",
        MACHINE,
        "bench",
    )
    assert told["content"] == ["stepdiag-result", "stepdiag-findings"]


def by_node(serving):
    done = subprocess.run(
        ["node", "results.mjs", serving.url],
        cwd=NODE,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(next(line for line in done.stdout.splitlines() if line.startswith("{")))


def test_the_day_of_leaving_a_tolerance_is_a_prognosis(tmp_path):
    """OPC 40501-1: 1 µrad a year from 5 is 10 after five years; both clients read the same time."""
    survey = prepared(tmp_path)
    write_rounds(
        survey.parent / "bench",
        [5.0 + number * (QUARTER / YEAR) for number in range(12)],
        tolerance=10.0,
    )

    async def work(client, _index, _own, machine, _management):
        index = await client.get_namespace_index("http://opcfoundation.org/UA/MachineTool/")
        (found,) = await (
            await machine.get_child([f"{index}:Notification", f"{index}:Prognoses"])
        ).get_children()
        parts = [
            await found.get_child(f"{index}:{name}") for name in ("PredictedTime", "Activity")
        ]
        return await found.read_type_definition(), *[
            await each.read_value() for each in parts
        ]

    with Serving(survey, "--plain") as serving:
        kind, time, activity = asked(serving, work)
        by_other = by_node(serving)["prognoses"]
    assert kind.Identifier == 9, "MaintenancePrognosisType"
    assert abs(time - (FIRST + 5 * YEAR)) < timedelta(days=30)
    assert activity.Text.startswith("C0Y will leave its tolerance of 10 µrad")
    assert by_other == {
        "C0Y": time.strftime("%Y-%m-%dT%H:%M:%S.") + f"{time.microsecond // 1000:03d}Z"
    }


def test_the_definition_of_a_result_is_the_published_one(serving):
    """A field that lets subtypes in, and no field of the abstract structure, for which clients have
    no decoder."""

    async def work(client, index, _own, _machine, _management):
        return index, await client.get_node(
            ua.NodeId(3008, index)
        ).read_data_type_definition()

    index, found = asked(serving, work)
    meta, content = found.Fields
    assert found.StructureType == ua.StructureType.StructureWithSubtypedValues
    assert (meta.Name, meta.DataType, meta.IsOptional) == (
        "ResultMetaData",
        ua.NodeId(3007, index),
        True,
    )
    assert (content.Name, content.DataType, content.ValueRank) == (
        "ResultContent",
        ua.NodeId(24),
        1,
    )


def test_the_meta_data_are_on_the_wire_as_an_extension_object(serving):
    """OPC 40001-101 lets subtypes stand there; a client with the published nodeset decodes it
    so."""

    async def work(_client, index, _own, _machine, management):
        return index, extensionobject_to_binary(
            (await management.call_method(f"{index}:GetLatestResult", NOW))[1]
        )

    index, wire = asked(serving, work)
    node = lambda number: bytes((2, index, 0)) + number.to_bytes(4, "little")  # noqa: E731
    assert wire.startswith(node(5008) + b"\1"), "Default Binary of ResultDataType"
    assert wire[12:].startswith(node(5005) + b"\1"), (
        "Default Binary of ResultMetaDataType, within"
    )


def test_an_unknown_result_is_an_error_and_no_result(serving):
    async def work(_client, index, _own, _machine, management):
        return await management.call_method(
            f"{index}:GetResultById", ua.Variant("nobody's", ua.VariantType.String), NOW
        )

    handle, _, error = asked(serving, work)
    assert handle == 0
    assert error < 0


def test_state_and_findings_are_variables(serving):
    async def work(_client, _index, own, machine, _management):
        state = await machine.get_child(f"{own}:State")
        values = {
            (await each.read_browse_name()).Name: await each.read_value()
            for each in await state.get_children()
        }
        return values, await (await machine.get_child(f"{own}:Findings")).read_value()

    state, findings = asked(serving, work)
    assert (state["Round"], state["Complete"], state["Recording"], state["Damage"]) == (
        "0001",
        True,
        False,
        "",
    )
    assert all(json.loads(each)["code"] for each in findings)


def put(path, whole):
    """Write a file as the daemon does: whole, or not at all."""
    part = path.with_name("result.json.part")
    part.write_bytes(whole)
    part.replace(path)


def test_round_and_findings_are_of_one_moment(serving, survey, tmp_path):
    """A round that has just begun has no findings: those of the round before would be taken for its
    own."""
    path, begun, away = (
        survey.parent / "bench/0001/result.json",
        survey.parent / "bench/0002",
        tmp_path,
    )
    whole = path.read_bytes()
    found = json.loads(whole)
    found["findings"] = [
        {
            "code": "noise-high",
            "severity": "warning",
            "action": "repeat",
            "text": "of the first round",
        }
    ]

    async def work(client, _index, own, machine, _management):
        names = (
            [f"{own}:State", f"{own}:Round"],
            [f"{own}:State", f"{own}:Complete"],
            [f"{own}:Findings"],
        )
        nodes = [(await machine.get_child(each)).nodeid for each in names]
        seen = []

        async def look():
            read = await client.uaclient.read_attributes(nodes, ua.AttributeIds.Value)
            assert len({each.SourceTimestamp for each in read[:2]}) == 1
            seen.append((*(each.Value.Value for each in read[:2]), bool(read[2].Value.Value)))
            return seen[-1]

        await asyncio.to_thread(put, path, json.dumps(found).encode())
        await until(look, lambda found: found[2])
        await asyncio.to_thread(begun.mkdir)
        await until(look, lambda found: found[0] == "0002")
        await asyncio.to_thread(put, begun / "result.json", path.read_bytes())
        await until(look, lambda found: found == ("0002", True, True))
        await asyncio.to_thread((begun / "result.json").rename, away / "result.json")
        await until(look, lambda found: found == ("0002", False, False))
        await asyncio.to_thread(begun.rename, away / "round")
        await asyncio.to_thread(put, path, whole)
        await until(
            look, lambda found: found == ("0001", True, bool(json.loads(whole)["findings"]))
        )
        return seen

    seen = asked(serving, work)
    assert ("0002", False, False) in seen
    assert {
        found for round_, complete, found in seen if (round_, complete) == ("0002", False)
    } == {False}
    assert {
        found for round_, complete, found in seen if (round_, complete) == ("0002", True)
    } == {True}


def test_nobody_changes_anything(serving):
    async def work(_client, index, own, machine, management):
        variable = (await (await management.get_child(f"{index}:Results")).get_children())[-1]
        refused = []
        for attempt in (
            machine.add_object(own, "evil"),
            variable.write_value(None),
            variable.delete(),
        ):
            try:
                await attempt
            except ua.UaError as error:
                refused.append(type(error).__name__)
        return refused

    assert asked(serving, work) == ["BadUserAccessDenied"] * 3


def test_a_new_result_is_an_event_a_damaged_one_a_word_in_the_state(serving, survey):
    path = survey.parent / "bench/0001/result.json"
    whole = path.read_bytes()

    def put(data):
        path.with_name("result.json.sha256").write_text(
            f"{hashlib.sha256(data).hexdigest()}  result.json\n"
        )
        path.write_bytes(data)

    class Ears:
        def __init__(self):
            self.heard = []

        def event_notification(self, event):
            self.heard.append(event)

    async def work(client, index, own, machine, management):
        ears = Ears()
        subscription = await client.create_subscription(50, ears)
        kind = await client.nodes.base_event_type.get_child(f"{index}:ResultReadyEventType")
        (ours,) = await kind.get_children(refs=ua.ObjectIds.HasSubtype)
        await subscription.subscribe_events(management, evtypes=[ours])
        damage = await machine.get_child([f"{own}:State", f"{own}:Damage"])
        results = await management.get_child(f"{index}:Results")
        before = (await management.call_method(f"{index}:GetLatestResult", NOW))[1]
        count = len(await results.get_children())
        await asyncio.to_thread(path.write_bytes, b"{")
        words = await until(damage.read_value, bool)
        kept = (await management.call_method(f"{index}:GetLatestResult", NOW))[1]
        await asyncio.to_thread(put, whole + b"\n")
        await until(damage.read_value, lambda found: not found)
        (event, *more) = await until(lambda: asyncio.sleep(0, ears.heard), bool)
        latest = (await management.call_method(f"{index}:GetLatestResult", NOW))[1]
        count = len(await results.get_children()) - count
        await asyncio.to_thread(put, whole)
        await until(
            lambda: management.call_method(f"{index}:GetLatestResult", NOW),
            lambda found: found[1] == before,
        )
        return before, words, kept, event, more, latest, count

    before, words, kept, event, more, latest, count = asked(serving, work)
    assert "0001/result.json" in words
    assert kept == before, "what was offered before stays"
    assert more == []
    fields = event.get_event_props_as_fields_dict()
    assert (
        fields["Result/ResultMetaData/ResultId"].Value
        == latest.ResultMetaData.ResultId
        != before.ResultMetaData.ResultId
    )
    assert fields["Result"].Value == latest
    assert count == 1, "the one before stays"


def test_with_a_certificate_all_is_encrypted_and_only_the_user_comes_in(survey, monkeypatch):
    for name in ("server", "client"):
        certificate(survey.parent, name)
    secret = survey.parent / "mes.password"
    secret.touch(0o600)
    secret.write_text(PASSWORD)

    async def come(user, password, *, secure=True):
        client = Client(serving.url, timeout=PATIENCE_S, watchdog_intervall=PATIENCE_S)
        client.application_uri = "urn:client"
        if secure:
            files = [
                survey.parent / each
                for each in ("client.pem", "client.key.pem", "server.pem")
            ]
            await client.set_security(
                SecurityPolicyBasic256Sha256, *files[:2], server_certificate=files[2]
            )
        client.set_user(user)
        client.set_password(password)
        async with client:
            return await client.get_namespace_array()

    options = (
        "--certificate",
        survey.parent / "server.pem",
        "--key",
        "server.key.pem",
        "--user",
        USER,
        "--password-file",
        secret.name,
    )
    with Serving(survey, *options) as serving:
        assert MODEL in asyncio.run(come(USER, PASSWORD))
        for refused in (
            come(USER, "wrong"),
            come("nobody", PASSWORD),
            come(USER, PASSWORD, secure=False),
        ):
            with pytest.raises((ua.UaError, OSError)):
                asyncio.run(refused)
        assert serving.process.poll() is None
        with pytest.raises(ua.uaerrors.BadUserAccessDenied):
            asyncio.run(come_in_the_clear(serving.url, monkeypatch, USER, PASSWORD))
    assert serving.process.returncode == 0, "SIGTERM ends it in good order"
    assert PASSWORD not in serving.said


async def come_in_the_clear(url, monkeypatch, user=None, password=None):
    """Open a channel in the clear, which is there for everybody to ask for the others, and a
    session on it without asking."""
    monkeypatch.setattr(
        Client, "find_endpoint", staticmethod(lambda endpoints, _mode, _policy: endpoints[0])
    )
    client = Client(url, timeout=PATIENCE_S, watchdog_intervall=PATIENCE_S)
    if user is not None:
        client.set_user(user)
        client.set_password(password)
    async with client:
        return await client.get_namespace_array()


def test_with_a_certificate_a_client_that_does_not_ask_what_is_offered_stays_out(
    survey, monkeypatch
):
    """Nobody gets a session in the clear, where nobody has to say a name either; where one has to,
    the test above asks."""
    certificate(survey.parent, "server")
    options = ("--certificate", survey.parent / "server.pem", "--key", "server.key.pem")
    with Serving(survey, *options) as serving, pytest.raises(ua.uaerrors.BadUserAccessDenied):
        asyncio.run(come_in_the_clear(serving.url, monkeypatch))


def test_a_key_of_another_certificate_is_refused(survey):
    """It would serve, and no client would ever come in."""
    for name in ("server", "client"):
        certificate(survey.parent, name)
    command = [
        sys.executable,
        "-m",
        "stepdiag",
        "publish",
        survey,
        "--opcua",
        f"127.0.0.1:{reserved_port()}",
    ]
    command += ["--certificate", survey.parent / "server.pem", "--key", "client.key.pem"]
    done = subprocess.run(
        [*map(str, command)], capture_output=True, text=True, timeout=PATIENCE_S, check=False
    )
    assert done.returncode == 2, done.stderr
    assert "found different content" in " ".join(done.stderr.split())


def certificate(folder, name):
    subprocess.run(
        [
            "openssl",
            "req",
            "-x509",
            "-newkey",
            "rsa:2048",
            "-nodes",
            "-days",
            "30",
            "-subj",
            f"/CN={name}",
            "-keyout",
            f"{name}.key.pem",
            "-addext",
            f"subjectAltName=URI:urn:{name},IP:127.0.0.1",
            "-out",
            f"{name}.pem",
        ],
        cwd=folder,
        capture_output=True,
        check=True,
        timeout=PATIENCE_S,
    )
    (folder / f"{name}.key.pem").chmod(0o600)


def test_a_port_that_is_taken_is_said(survey, serving):
    command = [
        sys.executable,
        "-m",
        "stepdiag",
        "publish",
        survey,
        "--plain",
        "--opcua",
        serving.url.split("/")[2],
    ]
    done = subprocess.run(
        [*map(str, command)], capture_output=True, text=True, timeout=PATIENCE_S, check=False
    )
    assert done.returncode == 4, done.stderr
    assert "a free address" in " ".join(done.stderr.split())
    assert "Traceback" not in done.stderr


def test_an_address_that_is_taken_is_refused_before_the_address_space_is_built(
    serving, monkeypatch
):
    async def built(_endpoint):
        raise AssertionError("the address space takes seconds")

    monkeypatch.setattr(opcua, "_prepared", built)
    taken = opcua.Endpoint(
        host="127.0.0.1", port=int(serving.url.split("/")[2].partition(":")[2])
    )
    with pytest.raises(DeviceError, match="a free address"):
        opcua.serve(None, None, taken, every_s=1.0)
