"""The programs with the arguments of manifests: their files are in a folder of the test, not in /etc or /data."""
import json
import os
import pathlib
import re
import subprocess

TOKEN = "a-token-of-the-manifests-test"


def clean_environment(**more):
    return {**{key: value for key, value in os.environ.items() if not key.startswith("VOXELPIPE_")}, **more}


def make_secrets(folder):
    """What the secrets voxelpipe-tls and voxelpipe-tokens hold, and the client's half: ca.pem, token. The certificate
    is that of docker/README.md, for the Service's name, and for localhost."""
    folder = pathlib.Path(folder)
    (folder / "tls").mkdir(parents=True)
    (folder / "tokens").mkdir()
    names = "subjectAltName=DNS:voxelpiped,DNS:localhost,IP:127.0.0.1"
    subprocess.run(
        [
            "openssl",
            "req",
            "-x509",
            "-newkey",
            "ec",
            "-pkeyopt",
            "ec_paramgen_curve:P-256",
            "-nodes",
            "-days",
            "90",
            "-subj",
            "/CN=voxelpiped",
            "-addext",
            names,
            "-keyout",
            folder / "tls/tls.key",
            "-out",
            folder / "tls/tls.crt",
        ],
        check=True,
        capture_output=True,
        timeout=60,
    )
    (folder / "ca.pem").write_bytes((folder / "tls/tls.crt").read_bytes())
    (folder / "token").write_text(TOKEN, encoding="utf-8")
    clients = {"clients": [{"name": "test", "role": "user", "token": TOKEN}]}
    (folder / "tokens/tokens.json").write_text(json.dumps(clients), encoding="utf-8")


def mapped(arguments, mounts):
    """In: arguments of a container, {path in the container: path here}. Out: the arguments with the paths here."""
    found = []
    for argument in arguments:
        for there, here in mounts.items():
            argument = re.sub(rf"(^|[= ]){re.escape(there)}(?=/|$)", rf"\g<1>{here}", argument)
        found.append(argument)
    return found


def checked_options(voxelpiped, arguments):
    """{flag: value} of all options of the server with these arguments, and "" or the error."""
    answer = subprocess.run(
        [voxelpiped, *arguments, "--check-config"],
        capture_output=True,
        text=True,
        timeout=60,
        env=clean_environment(),
        check=False,
    )
    if answer.returncode != 0:
        return {}, answer.stderr.strip()
    return {f"--{key}": value.strip('"') for key, value in re.findall(r"^([a-z-]+) = (\S+)", answer.stdout, re.M)}, ""


def known_flags(voxelpipe, command):
    """The flags of a command of `voxelpipe`."""
    text = subprocess.run(
        [voxelpipe, command, "--help"], capture_output=True, text=True, timeout=60, env=clean_environment(), check=True
    ).stdout
    return set(re.findall(r"(?<![\w-])--[a-z][a-z-]*", text))
