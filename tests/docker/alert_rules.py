"""usage: alert_rules.py REPOSITORY VOXELPIPED

Runs `promtool test rules` on tests/docker/alerts.test.yaml, which has a case in which each alert of docker/alerts.yaml
fires and one in which it does not; looks up every metric and label of the alerts at a real server; and every alert's
paragraph in docker/README.md. Exit 77 with the reason where promtool or a module of Python is missing.
"""
import pathlib
import re
import shutil
import subprocess
import sys
import urllib.request

try:
    import yaml
except ImportError as error:
    print(f"SKIPPED: {error} (docker/packages-operations.txt)")
    sys.exit(77)

# What Prometheus itself adds.
OWN_METRICS, OWN_LABELS = {"up"}, {"job", "instance", "le"}


def promtool(*arguments):
    answer = subprocess.run(
        ["promtool", *map(str, arguments)], capture_output=True, text=True, timeout=120, check=False
    )
    assert answer.returncode == 0, f"promtool {arguments[0]} {arguments[1]}:\n{answer.stdout}{answer.stderr}"
    return answer.stdout


def read_rules(path):
    return {
        rule["alert"]: rule
        for group in yaml.safe_load(path.read_text(encoding="utf-8"))["groups"]
        for rule in group["rules"]
    }


def check_cases(alerts, cases):
    """Each alert is seen to fire, and seen not to."""
    fires, silent = set(), set()
    for case in cases["tests"]:
        for test in case["alert_rule_test"]:
            (fires if test["exp_alerts"] else silent).add(test["alertname"])
    assert fires == silent == set(alerts), f"without a case: {set(alerts) - fires}, {set(alerts) - silent}"


def read_metrics(voxelpiped):
    """The text of /metrics of a server."""
    with subprocess.Popen(
        [voxelpiped, "--listen=127.0.0.1:0", "--http-listen=127.0.0.1:0", "--log-level=error"],
        stdout=subprocess.PIPE,
        text=True,
    ) as server:
        try:
            address = [
                line for line in (server.stdout.readline(), server.stdout.readline()) if line.startswith("http on ")
            ]
            url = f"http://{address[0].removeprefix('http on ').strip()}/metrics"
            with urllib.request.urlopen(url, timeout=30) as answer:
                return answer.read().decode()
        finally:
            server.kill()


def check_names(rules, metrics, operations):
    """In: /metrics, and the operator's page, which lists what a server has only after an event."""
    samples = dict.fromkeys(re.findall(r"^([a-z_]+)", metrics, re.M))
    listed = set(re.findall(r"^\| `([a-z_]+)` \|", operations, re.M))
    for alert, rule in rules.items():
        for name, labels in re.findall(r"\b((?:voxelpipe|process)_[a-z_]+|up)\b(?:\{([^}]*)\})?", rule["expr"]):
            base = re.sub(r"_bucket$", "", name)
            assert name in samples or base in listed or name in OWN_METRICS, f"{alert}: no server has {name}"
            for label, values in re.findall(r'(\w+)=~?"([^"]*)"', labels):
                if label in OWN_LABELS:
                    continue
                for value in values.split("|"):
                    known = (
                        re.search(rf'^{name}\{{[^}}]*{label}="{value}"', metrics, re.M) or f"`{value}`" in operations
                    )
                    assert known, f"{alert}: no server has {name} with {label}={value}"


def main():
    repository, voxelpiped = (pathlib.Path(argument).resolve() for argument in sys.argv[1:3])
    if shutil.which("promtool") is None:
        print("SKIPPED: promtool is not installed (docker/packages-prometheus.txt)")
        return 77
    test = repository / "tests/docker/alerts.test.yaml"
    promtool("check", "config", repository / "docker/prometheus.yaml")  # and the rules that it names
    promtool("test", "rules", test)
    rules = read_rules(repository / "docker/alerts.yaml")
    check_cases(rules, yaml.safe_load(test.read_text(encoding="utf-8")))
    check_names(rules, read_metrics(voxelpiped), (repository / "server/OPERATIONS.md").read_text(encoding="utf-8"))
    readme = (repository / "docker/README.md").read_text(encoding="utf-8")
    for alert, rule in rules.items():
        assert rule["annotations"]["runbook"] == f"docker/README.md#{alert.lower()}", alert
        assert f"\n#### {alert}\n" in readme, f"docker/README.md does not say what to do about {alert}"
    print(f"{len(rules)} alerts")
    return 0


if __name__ == "__main__":
    sys.exit(main())
