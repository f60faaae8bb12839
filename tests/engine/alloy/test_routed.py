"""Networks of sessions and routers: Alloy and the native search agree in deployments by chance."""

from __future__ import annotations

import re
import shutil
from datetime import datetime, timezone
from itertools import pairwise, permutations
from pathlib import Path
from random import Random

import pytest
from msgspec.structs import replace

from keystore_audit import resources
from keystore_audit.engine.alloy.install import Engine
from keystore_audit.engine.alloy.routed import MODULES, Facts, may_get_through
from keystore_audit.engine.alloy.runner import analyzer_of
from keystore_audit.keystore.keystore import read_keystore
from keystore_audit.profiles import ROUTED
from keystore_audit.zenoh.flow import walks
from keystore_audit.zenoh.network import read_network
from keystore_audit.zenoh.participants import OUTSIDER, End, NetworkFlows, Question, flows_in
from tests.amount import tried
from tests.cli.keystores import run_at
from tests.engine.alloy_batch import outcomes, shipped
from tests.oracles.zenoh import deployment
from tests.oracles.zenoh.case import Case
from tests.oracles.zenoh.deployment import Configuration
from tests.oracles.zenoh.test_flows import flows
from tests.oracles.zenoh.test_random import NAMES, deployed

pytestmark = [pytest.mark.alloy, pytest.mark.xdist_group("alloy")]
SAMPLES = Path(__file__).resolve().parents[3] / "sample_keystores"
AT = datetime(2026, 11, 21, 12, tzinfo=timezone.utc)
TOPICS = ("*/chatter/*/*", "0/chatter/*/*", "0/other/*/*", "1/*/*/*", "0/ch$*/*/*")


def asked(chance: Random, there: NetworkFlows) -> Question:
    """Some question: mostly about those whose files are there."""
    known = [each for each in there.participants if not each.unseen]

    def end() -> End:
        kind = chance.random()
        if kind < 0.2:
            return End(topics=tuple(chance.sample(TOPICS, 2)))
        return End(participants=(chance.choice(known if kind < 0.9 else there.participants),))

    through = tuple(each for each in there.participants if each.unseen or chance.random() < 0.2)
    source, target = end(), end()
    attacking = chance.choice(((), source.participants, target.participants, there.participants))
    return Question(source=source, target=target, attacking=attacking, through=through, ambient=chance.random() < 0.5)


def odd(chance: Random, each: Configuration) -> Configuration:
    """Now and then what is rare: subjects by id or interface, brokering."""
    if "access_control" in each and chance.random() < 0.3:
        subject = chance.choice(each["access_control"]["subjects"])
        subject |= {chance.choice(("zids", "interfaces")): ["ab"]}
    if each["mode"] == "router" and chance.random() < 0.3:
        each |= {"routing": {"router": {"peers_failover_brokering": True}}}
    return each


@pytest.mark.slow
def test_both_engines_say_alike_whether_anything_may_get_through(tmp_path: Path, analyzer: Engine) -> None:
    root, differing, told = tmp_path / "keystore", [], {True: 0, False: 0}
    deployment.keystore(root)
    for name in {each.name for each in (root / "enclaves").iterdir()} - {*NAMES, "zenohd"}:
        shutil.rmtree(root / "enclaves" / name)
    keystore = read_keystore(root)
    with analyzer_of(analyzer, 300) as solver:
        for seed in range(tried(150)):
            chance = Random(seed)
            case = deployed(chance, root, seed)
            case = replace(case, sessions={name: odd(chance, each) for name, each in case.sessions.items()})
            there, release = flows(case, keystore, tmp_path / f"{seed}"), chance.choice([*ROUTED.values()])
            question = asked(chance, there)
            if question.source == question.target == End(participants=(OUTSIDER,)):
                continue
            native = walks(there, question, release, certain=False).shortest(question) is not None
            told[native] += 1
            if may_get_through(there, question, release, solver) is not native:
                differing.append(seed)
    assert differing == []
    assert min(told.values()) * 5 >= sum(told.values())


def example() -> str:
    """The facts of the sample, as they stand in the source tree."""
    keystore = read_keystore(SAMPLES / "zenoh/turtlesim_clients")
    there = NetworkFlows(keystore, read_network(SAMPLES / "networks/turtlesim_clients", keystore, AT))
    ends = {name: End(participants=there.named([name])) for name in ("/random", "/turtlesim")}
    through = there.named(["/zenohd"])
    source, target = ends["/turtlesim"], ends["/random"]
    question = Question(source=source, target=target, attacking=there.participants, through=through)
    text, _atoms = Facts(there, question, ROUTED["zenoh-1.7"]).text()
    return text.replace(f"{SAMPLES}/", "")


def test_the_example_in_the_source_tree_is_what_would_be_written_today() -> None:
    """It lets the modules run by themselves."""
    assert (resources.alloy() / "network.als").read_text() == example()


@pytest.mark.parametrize("module", [*(name.removesuffix(".als") for name in MODULES), "network"])
def test_each_module_opens_and_runs_by_itself(module: str, tmp_path: Path) -> None:
    modules = shipped() | {"alone.als": f"module alone\nopen {module}\nrun nothing {{ no none }} for 0\n"}
    assert outcomes(tmp_path, modules, "alone.als") == {"nothing": True}


def test_each_module_opens_one_other_and_says_what_it_declares() -> None:
    for before, module in pairwise(("routing", "network", "routed")):
        assert re.findall(r"^open (\w+)$", shipped()[f"{module}.als"], re.MULTILINE) == [before]
    for module in MODULES:
        for before, line in pairwise(shipped()[module].split("\n")):
            if re.match(r"(abstract sig|one sig|sig|fun|pred|assert|fact)\b", line):
                assert before.endswith("*/"), f"{module}: {line}"


def test_relations_are_all_explained() -> None:
    """What the generated module has, the first one explains."""
    words = {*re.findall(r"\w+", shipped()["routing.als"].partition("module routing")[0])}
    assert {*re.findall(r"^fun (\w+)", shipped()["network.als"], re.MULTILINE)} <= words


def test_names_of_users_stand_in_comments_alone(tmp_path: Path) -> None:
    root = deployment.keystore(tmp_path / "keystore")
    told = []
    for name, text in (("plain", "0/a/*/*"), ("hostile", "0/a} run {\u202e\n*//T/*/*".replace("\n", ""))):
        rules = deployment.access(({"cert_common_names": [text]}, [deployment.allow("0/a/*/*")]))
        there = {
            "one": deployment.session("peer", listen=["tls/localhost:1"], **rules, **deployment.tls(root, "talker"))
        }
        found = flows(Case("", "", there, (), "", ""), read_keystore(root), tmp_path / name)
        question = Question(source=End(), target=End())
        told.append(Facts(found, question, ROUTED["zenoh-1.7"]).text()[0])
    plain, hostile = (re.sub(r"^--.*$|_\w+", "", each, flags=re.MULTILINE) for each in told)
    assert plain == hostile
    assert told[1].isascii()


@pytest.mark.parametrize("sample", ["turtlesim_clients", "turtlesim_generated"])
def test_a_written_model_answers_as_flows_do(sample: str, tmp_path: Path) -> None:
    """By the checks that it shows its readers, of whoever attacks."""
    root, folder, release = SAMPLES / "zenoh" / sample, SAMPLES / "networks" / sample, ROUTED["zenoh-1.7"]
    words = ("model", str(root), "--zenoh", str(folder), "-o", "m", "--profile", release.name)
    assert run_at(tmp_path, *words).returncode == 0
    written = {each.name: each.read_text() for each in (tmp_path / "m" / release.name).iterdir()}
    there = flows_in(read_keystore(root), folder, AT)
    shown = re.findall(r"check ({.*}) for 0", written["asked.als"])
    expected, checks = {}, []
    for (n, source), (m, target) in permutations(enumerate(there.participants), 2):
        for (by, check), attacking in zip(enumerate(shown), ((), (source,), there.participants), strict=True):
            name = f"From{n}To{m}By{by}"
            ends = End(participants=(source,)), End(participants=(target,))
            question = Question(source=ends[0], target=ends[1], attacking=attacking)
            expected[name] = walks(there, question, release, certain=False).shortest(question) is not None
            body = check.replace("Participant1", f"Participant_{m}").replace("Participant0", f"Participant{n}")
            checks.append(f"check {name} {body.replace('Participant_', 'Participant')} for 0")
    found = outcomes(tmp_path, written | {"asked.als": "\n".join([written["asked.als"], *checks])}, "asked.als")
    assert found == {"FactsAreConsistent": True, **expected}
    assert len({*expected.values()}) == 2
