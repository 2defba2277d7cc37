"""usage: kubectl_test.py REPOSITORY

`kubectl kustomize` makes of every overlay of docker/kubernetes/ what the tests' own renderer makes of it. Exit 77 with
the reason where there is no kubectl with kustomize 5.
"""
import pathlib
import shutil
import subprocess
import sys

try:
    import yaml
except ImportError as error:
    print(f"SKIPPED: {error} (docker/packages-operations.txt)")
    sys.exit(77)

import kustomize


def main():
    repository = pathlib.Path(sys.argv[1]).resolve()
    if shutil.which("kubectl") is None:
        print("SKIPPED: there is no kubectl")
        return 77
    told = subprocess.run(
        ["kubectl", "version", "--client"], capture_output=True, text=True, timeout=60, check=False
    ).stdout
    if "Kustomize Version: v5" not in told:
        print(f"SKIPPED: kubectl without kustomize 5: {told}")
        return 77
    for overlay in sorted((repository / "docker/kubernetes/overlays").glob("*/*")):
        text = subprocess.run(
            ["kubectl", "kustomize", overlay], capture_output=True, text=True, timeout=60, check=True
        ).stdout
        theirs = {kustomize.identity(document): document for document in yaml.safe_load_all(text)}
        ours = {kustomize.identity(document): document for document in kustomize.render(overlay)}
        assert theirs == ours, f"{overlay}:\n{theirs}\n{ours}"
        print(f"{overlay.relative_to(repository)}: {len(ours)} manifests, the same")
    return 0


if __name__ == "__main__":
    sys.exit(main())
