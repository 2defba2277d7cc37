"""usage: manifests_test.py REPOSITORY VOXELPIPED VOXELPIPE VERSION

Renders every overlay of docker/kubernetes/ and checks it against closed schemas, the rules of rules.py, and what the
programs themselves accept; then that each of the mistakes of mistakes.py is refused, by the text that it is there for.
Exit 77 with the reason where a module of Python is missing.
"""
import copy
import pathlib
import subprocess
import sys
import tempfile

try:
    import jsonschema  # pylint: disable=unused-import
    import yaml  # pylint: disable=unused-import
except ImportError as error:
    print(f"SKIPPED: {error} (docker/packages-operations.txt)")
    sys.exit(77)

import kustomize
import mistakes
import programs
import rules
import schemas


class Checker:
    def __init__(self, voxelpiped, voxelpipe, version, metrics, secrets):
        self.voxelpiped, self.version, self.metrics, self.secrets = voxelpiped, version, metrics, secrets
        self.flags = {command: programs.known_flags(voxelpipe, command) for command in ("batch", "aggregate")}

    def argument_problems(self, documents):
        """What the programs say to the arguments, and all options of the server."""
        found, options = [], {}
        for document in documents:
            if document["kind"] not in ("Deployment", "Job"):
                continue
            container = document["spec"]["template"]["spec"]["containers"][0]
            if document["kind"] == "Deployment":
                arguments = programs.mapped(container["args"], {"/etc/voxelpipe": str(self.secrets)})
                options, error = programs.checked_options(self.voxelpiped, arguments)
                found += [f"arguments: {error}"] if error else []
            else:
                _, command, *arguments = rules.words_of(container)
                given = {argument.split("=")[0] for argument in arguments if argument.startswith("--")}
                unknown = given - self.flags[command]
                found += [f"arguments: {command} has no {flag}" for flag in sorted(unknown)]
        return found, options

    def problems(self, documents, gpu):
        found = [text for document in documents for text in schemas.problems(document)]
        if found:
            return found  # the rules rely on the form
        found, options = self.argument_problems(documents)
        if found:
            return found
        facts = {"version": self.version, "metrics": self.metrics, "options": options}
        return rules.problems(rules.Deck(documents, gpu, facts))


def metric_names(operations_md):
    """As the operator's page lists them; a test of the server holds the two together."""
    lines = operations_md.read_text(encoding="utf-8").splitlines()
    return {line.split("`")[1] for line in lines if line.startswith(("| `voxelpipe_", "| `process_"))}


def check_mistakes(checker, documents, planted, gpu=False):
    for name, plant, refusal in planted:
        changed = copy.deepcopy(documents)
        plant(changed)
        assert changed != documents, f"{name}: changes nothing"
        found = checker.problems(changed, gpu)
        assert any(refusal in text for text in found), f"not refused: {name}: {found}"
    return len(planted)


def main():
    repository, voxelpiped, voxelpipe = (pathlib.Path(argument).resolve() for argument in sys.argv[1:4])
    version = sys.argv[4]
    top = repository / "docker/kubernetes"
    with tempfile.TemporaryDirectory() as folder:
        secrets = pathlib.Path(folder) / "voxelpipe"
        programs.make_secrets(secrets)
        checker = Checker(voxelpiped, voxelpipe, version, metric_names(repository / "server/OPERATIONS.md"), secrets)
        count = 0
        for target in ("cpu", "gpu"):
            overlay = top / "overlays" / target
            server, batch, aggregate = (kustomize.render(overlay / name) for name in ("server", "batch", "aggregate"))
            for documents in (server, batch + aggregate):
                found = checker.problems(documents, gpu=target == "gpu")
                assert not found, "\n".join([str(overlay), *found])
            if target == "gpu":
                count += check_mistakes(checker, server, mistakes.GPU, gpu=True)
            else:
                count += check_mistakes(checker, server, mistakes.SERVER)
                count += check_mistakes(checker, batch + aggregate, mistakes.BATCH)
    used = {path for path in top.rglob("*.yaml")}
    print(f"{len(used)} files, 6 overlays, {count} mistakes refused")
    return 0


if __name__ == "__main__":
    sys.exit(main())
