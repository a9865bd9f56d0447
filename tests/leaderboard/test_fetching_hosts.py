"""Which hosts predictions are fetched from: by name, public, and all that they lead on to."""

from __future__ import annotations

from pathlib import Path

import pytest

from airzoo_bench.core.errors import SubmissionError
from airzoo_bench.leaderboard.addresses import WebAddress, public_addresses
from airzoo_bench.leaderboard.fetching import fetch
from tests.leaderboard.web_server import (
    CONTENT,
    HOST,
    OTHER,
    PUBLIC,
    URL,
    WebServer,
    head,
    plain,
    redirect,
    refusal,
    sha256,
)


@pytest.mark.parametrize(
    "url",
    [
        "http://data.example.org/a.npz",
        "file:///etc/passwd",
        "ftp://data.example.org/a.npz",
        "//data.example.org/a.npz",
        "https:data.example.org",
        "https:///a.npz",
        "https://user@data.example.org/a.npz",
        "https://data.example.org@127.0.0.1/a.npz",
        "https://data.example.org:8443/a.npz",
        "https://data.example.org:/a.npz",
        "https://data.example.org./a.npz",
        "https://localhost/a.npz",
        "https://127.0.0.1/a.npz",
        "https://2130706433/a.npz",
        "https://0x7f.0.0.1/a.npz",
        "https://0177.0.0.1/a.npz",
        "https://127.1/a.npz",
        "https://[::1]/a.npz",
        "https://[::ffff:127.0.0.1]/a.npz",
        "https://169.254.169.254/latest/meta-data",
        "https://dаta.example.org/a.npz",  # a Cyrillic letter
        "https://xn--dta-7cd.example.org/a.npz",
        "https://data。example。org/a.npz",
        "https://data.example.org/a\r\nHost: other.org",
        "https://data.example.org/a b",
        "https://data.example.org\\@127.0.0.1/a.npz",
        "https://data_x.example.org/a.npz",
        "https://data..example.org/a.npz",
        "https://data.example.org/" + "a" * 9000,
        "",
    ],
)
def test_addresses_that_are_not_taken(url: str, web: WebServer, tmp_path: Path) -> None:
    def nobody(host: str) -> list[str]:
        raise AssertionError("an address that is refused must not be resolved")

    message = refusal(web, tmp_path, url, network=web.network(nobody))
    assert "expected: https://HOST/PATH" in message
    assert message.isprintable() or "\n  expected" in message
    assert "\r" not in message


def test_an_address_with_a_user_is_told_so() -> None:
    with pytest.raises(SubmissionError, match="has a user name"):
        WebAddress.parse("https://data.example.org@127.0.0.1/a.npz")


class TestPublicHosts:
    @pytest.mark.parametrize(
        "address",
        [
            "127.0.0.1",
            "127.8.8.8",
            "0.0.0.0",
            "10.1.2.3",
            "172.16.0.1",
            "192.168.1.1",
            "100.64.0.1",
            "169.254.169.254",
            "192.0.0.170",
            "192.0.2.1",
            "198.18.0.1",
            "192.88.99.1",
            "224.0.0.1",
            "240.0.0.1",
            "255.255.255.255",
            "::",
            "::1",
            "::127.0.0.1",
            "::ffff:127.0.0.1",
            "::ffff:93.184.215.14",
            "fe80::1",
            "fe80::1%eth0",
            "fc00::1",
            "fec0::1",
            "fd00:ec2::254",
            "ff02::1",
            "2001::1",
            "2001:db8::1",
            "2002:7f00:1::",
            "64:ff9b::7f00:1",
            "64:ff9b:1::7f00:1",
            "not an address",
        ],
    )
    def test_others_are_refused_before_any_connection(
        self, address: str, web: WebServer, tmp_path: Path
    ) -> None:
        network = web.network(lambda host: [PUBLIC, address])
        assert "is not public" in refusal(web, tmp_path, network=network)
        assert web.dialled == []

    def test_public_ones_are_taken(self) -> None:
        found = ["93.184.215.14", "8.8.8.8", "2606:2800:21f:cb07::1"]
        assert public_addresses(HOST, lambda host: found) == found

    def test_a_name_of_this_machine_is_refused_with_the_real_resolver(self, tmp_path: Path) -> None:
        with pytest.raises(SubmissionError, match=r"cannot be found|is not public"):
            fetch("https://airzoo.localhost/a.npz", tmp_path, size=1, sha256="0" * 64)

    def test_a_name_that_leads_elsewhere_the_second_time_is_asked_once(
        self, web: WebServer, tmp_path: Path
    ) -> None:
        asked = iter([[PUBLIC], ["127.0.0.1"], ["169.254.169.254"]])
        web.answers["/files/preds.npz"] = redirect("/moved.npz")
        web.answers["/moved.npz"] = plain(CONTENT)
        network = web.network(lambda host: next(asked))
        fetch(URL, tmp_path, size=len(CONTENT), sha256=sha256(CONTENT), network=network)
        assert web.dialled == [PUBLIC, PUBLIC]
        assert next(asked) == ["127.0.0.1"]

    @pytest.mark.parametrize("found", [OSError("no such name"), []])
    def test_hosts_without_address(
        self, found: OSError | list[str], web: WebServer, tmp_path: Path
    ) -> None:
        def resolve(host: str) -> list[str]:
            if isinstance(found, OSError):
                raise found
            return found

        assert HOST in refusal(web, tmp_path, network=web.network(resolve))


class TestRedirects:
    @pytest.mark.parametrize(
        "location",
        [
            "https://169.254.169.254/latest",
            "https://127.0.0.1/x",
            "https://[::1]/x",
            "http://data.example.org/x",
            "file:///etc/passwd",
            "https://user@data.example.org/x",
            "//127.0.0.1/x",
        ],
    )
    def test_to_what_is_not_taken_are_refused(
        self, location: str, web: WebServer, tmp_path: Path
    ) -> None:
        web.answers["/files/preds.npz"] = redirect(location)
        refusal(web, tmp_path)
        assert web.dialled == [PUBLIC]

    def test_to_another_public_host_are_followed(self, web: WebServer, tmp_path: Path) -> None:
        """As Hugging Face and releases of GitHub do: to a signed address of a long name."""
        there = "/signed" + "a" * 2500 + "?Expires=5"
        web.answers["/files/preds.npz"] = redirect(f"https://{OTHER}{there}")
        web.answers[there] = plain(CONTENT)
        addresses = {HOST: [PUBLIC], OTHER: ["8.8.8.8"]}
        found = fetch(
            URL, tmp_path, size=len(CONTENT), sha256=sha256(CONTENT),
            network=web.network(addresses.__getitem__),
        )  # fmt: skip
        assert found.name == "preds.npz"
        assert web.dialled == [PUBLIC, "8.8.8.8"]
        assert f"\r\nHost: {OTHER}\r\n".encode() in web.requests[1]

    @pytest.mark.parametrize("address", ["127.0.0.1", "10.0.0.1", "169.254.169.254", "::1"])
    def test_to_a_name_of_no_public_address_are_refused(
        self, address: str, web: WebServer, tmp_path: Path
    ) -> None:
        web.answers["/files/preds.npz"] = redirect(f"https://{OTHER}/x")
        addresses = {HOST: [PUBLIC], OTHER: ["8.8.8.8", address]}
        network = web.network(addresses.__getitem__)
        assert "is not public" in refusal(web, tmp_path, network=network)
        assert web.dialled == [PUBLIC]

    def test_without_end(self, web: WebServer, tmp_path: Path) -> None:
        web.answers["/files/preds.npz"] = redirect("/files/preds.npz")
        assert "leads on more than 5 times" in refusal(web, tmp_path)
        assert len(web.dialled) == 6

    def test_text_of_the_host_is_never_printed_as_it_is(
        self, web: WebServer, tmp_path: Path
    ) -> None:
        web.answers["/files/preds.npz"] = redirect("https://evil.example/\x1b[2Jgone")
        assert "\x1b" not in refusal(web, tmp_path)
        web.answers["/files/preds.npz"] = lambda _, peer: peer.sendall(
            head(status="500 \x1b[31mred")
        )
        assert "\x1b" not in refusal(web, tmp_path)
