"""The report page of a few runs, written once, and a real browser to look at them."""

import awkward
import browser as chromium
import pytest

from tcbench.report.write_report import write_report

SIXTY = [*awkward.FIVE, *awkward.PEERS, *(f"method_{i:02d}" for i in range(53))]
READY = "() => document.documentElement.dataset.ready"


def write(folder, methods, scenarios=awkward.SCENARIOS, extra=None, **settings):
    tables = awkward.everything(methods, scenarios, **settings) | (extra or {})
    return write_report(awkward.write_run(folder / "run", tables, (), awkward.declared(methods, scenarios)))


@pytest.fixture(scope="session")
def full(tmp_path_factory):
    return write(tmp_path_factory.mktemp("full"), [*awkward.FIVE, *awkward.PEERS])


@pytest.fixture(scope="session")
def sixty(tmp_path_factory):
    return write(tmp_path_factory.mktemp("sixty"), SIXTY, extra=awkward.ensemble(SIXTY))


@pytest.fixture(scope="session")
def large(tmp_path_factory):
    """As many methods and scenarios as there are, with names as long, and an ensemble."""
    methods = [*awkward.FIVE, *awkward.PEERS, *(f"a_method_of_ours_{i:02d}" for i in range(19))]
    scenarios = ["relative_equilibrium", *awkward.SCENARIOS, "bound_equilibrium", "fast_conduction", "long_term", "gas"]
    return write(tmp_path_factory.mktemp("large"), methods, scenarios, extra=awkward.ensemble(methods))


@pytest.fixture(scope="session")
def alone(tmp_path_factory):
    return write(tmp_path_factory.mktemp("alone"), ["tc_monolithic"], ["short_term"])


@pytest.fixture(scope="session")
def failed(tmp_path_factory):
    return write(tmp_path_factory.mktemp("failed"), awkward.FIVE, failing=lambda name, h: True)


@pytest.fixture(scope="session")
def hostile(tmp_path_factory):
    return awkward.write_hostile(tmp_path_factory.mktemp("hostile") / "run", write_report)[0]


@pytest.fixture(scope="session")
def browser():
    yield from chromium.launched()


@pytest.fixture
def visit(browser):
    """Open a page; afterwards: no console message, no request but for the page itself."""
    contexts, messages, requests = [], [], []

    def opened(path, place="", width=1400, **settings):
        context = browser.new_context(viewport={"width": width, "height": 900}, **settings)
        contexts.append(context)
        page = context.new_page()
        page.on("console", lambda message: messages.append(message.text))
        page.on("pageerror", lambda error: messages.append(str(error)))
        page.on("dialog", lambda dialog: (messages.append("dialog"), dialog.dismiss()))
        page.on("request", lambda request: requests.append(request.url))
        page.goto(path.as_uri() + place)
        if settings.get("java_script_enabled", True):
            page.wait_for_function(READY)
        return page

    yield opened
    for context in contexts:
        context.close()
    assert messages == []
    assert [url[:100] for url in requests if not url.startswith(("file:", "data:", "blob:"))] == []
    assert len([url for url in requests if url.startswith("file:")]) == len(contexts)
