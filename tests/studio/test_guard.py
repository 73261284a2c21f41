"""Who is let in: the page that this server gave out, under its own name."""

from __future__ import annotations

import pytest

from tests.studio.conftest import OWN, TOKEN, Studio


@pytest.mark.parametrize("path", ["/", "/guess/", f"/{TOKEN}", f"/{TOKEN}x/", "/static/studio.js"])
def test_nothing_without_the_token(studio: Studio, path: str) -> None:
    answer = studio.browser.get(path)
    assert answer.status_code == 404 and answer.text.count("\n") == 1


@pytest.mark.parametrize("host", ["evil.example:8745", "127.0.0.1", "127.0.0.1:80", ""])
def test_another_name_is_refused(studio: Studio, host: str) -> None:
    """A page elsewhere whose name resolves to this machine asks under that name."""
    answer = studio.browser.get(f"/{TOKEN}/", headers={"host": host})
    assert answer.status_code == 403
    assert studio.browser.get(f"/{TOKEN}/", headers={"host": "localhost:8745"}).status_code == 200


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://127.0.0.1:80", ""])
def test_another_page_may_not_post(studio: Studio, origin: str) -> None:
    for method, path in (("POST", "check"), ("PUT", "files/a.csv"), ("DELETE", "")):
        answer = studio.browser.request(
            method, f"/{TOKEN}/{path}", headers={"origin": origin}, content=b"a"
        )
        assert answer.status_code == 403
    assert studio.jobs.latest("check") is None and studio.session.logs() == []


def test_another_page_may_not_show_this_one(studio: Studio) -> None:
    answer = studio.browser.get(f"/{TOKEN}/", headers={"sec-fetch-site": "cross-site"})
    assert answer.status_code == 403


def test_the_page_loads_from_this_server_alone(studio: Studio) -> None:
    answer = studio.browser.get(f"/{TOKEN}/")
    policy = answer.headers["content-security-policy"]
    assert policy.startswith("default-src 'self';") and "unsafe" not in policy
    assert answer.headers["referrer-policy"] == "same-origin"
    for name in ("", "page.css", "static/studio.css", "static/studio.js"):
        text = studio.get(name).replace(OWN, "")
        assert "://" not in text.replace("http://www.w3.org/2000/svg", ""), name


def test_vendored_htmx_is_the_one_that_was_looked_at(studio: Studio) -> None:
    import hashlib

    script = studio.get("static/htmx.min.js")
    told = studio.get("static/htmx.LICENSE")
    assert hashlib.sha256(script.encode()).hexdigest() in told
    assert 'version:"2.0.11"' in script and "htmx.org 2.0.11" in told
