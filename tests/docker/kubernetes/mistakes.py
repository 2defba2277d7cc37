"""Mistakes for the manifests of docker/kubernetes/: each is a name, a change of the manifests of an overlay, and a part
of the text that must refuse it."""


def only(documents, kind, name=None):
    return next(
        document for document in documents if document["kind"] == kind and name in (None, document["metadata"]["name"])
    )


def pod(documents, kind="Deployment"):
    return only(documents, kind)["spec"]["template"]["spec"]


def container(documents, kind="Deployment"):
    return pod(documents, kind)["containers"][0]


def job(documents):
    return only(documents, "Job", "voxelpipe-batch")["spec"]


def aggregate(documents):
    return only(documents, "Job", "voxelpipe-aggregate")["spec"]["template"]["spec"]["containers"][0]


def rename(mapping, old, new):
    mapping[new] = mapping.pop(old)


def set_argument(one, start, new):
    place = next(i for i, argument in enumerate(one["args"]) if argument.startswith(start))
    one["args"][place : place + 1] = [new] if new else []


def drop_rule(documents, test):
    rules = job(documents)["podFailurePolicy"]["rules"]
    rules[:] = [rule for rule in rules if not test(rule)]


SERVER = [
    ("a misspelt probe", lambda d: rename(container(d), "readinessProbe", "readinesProbe"), "readinesProbe"),
    (
        "a misspelt field of the pod",
        lambda d: rename(pod(d), "terminationGracePeriodSeconds", "terminationGracePeriod"),
        "terminationGracePeriod",
    ),
    ("a number as a text", lambda d: pod(d).update(terminationGracePeriodSeconds="60"), "'60' is not of type"),
    (
        "a version that is gone",
        lambda d: only(d, "HorizontalPodAutoscaler").update(apiVersion="autoscaling/v2beta2"),
        "autoscaling/v2beta2",
    ),
    ("a field at the wrong depth", lambda d: only(d, "Deployment")["spec"].update(containers=[]), "containers"),
    (
        "a probe on the port of calls",
        lambda d: container(d)["readinessProbe"]["httpGet"].update(port="grpc"),
        "readinessProbe: asks at port grpc",
    ),
    (
        "a probe at a path that is not there",
        lambda d: container(d)["livenessProbe"]["httpGet"].update(path="/healthz"),
        "livenessProbe: asks for /healthz",
    ),
    (
        "liveness by readiness",
        lambda d: container(d)["livenessProbe"]["httpGet"].update(path="/readyz"),
        "livenessProbe: asks for /readyz",
    ),
    ("no startup probe", lambda d: container(d).pop("startupProbe"), "startupProbe: is missing"),
    ("a probe with TLS", lambda d: container(d)["startupProbe"]["httpGet"].update(scheme="HTTPS"), "has no TLS"),
    (
        "a port that the server does not listen at",
        lambda d: container(d)["ports"][0].update(containerPort=50052),
        "port grpc: the container opens 50052",
    ),
    (
        "a server that listens at loopback",
        lambda d: set_argument(container(d), "--listen", "--listen=127.0.0.1:50051"),
        "other pods cannot reach",
    ),
    (
        "a Service to a port without a name",
        lambda d: only(d, "Service")["spec"]["ports"][0].update(targetPort="rpc"),
        "leads to rpc",
    ),
    ("a Service with an address", lambda d: only(d, "Service")["spec"].update(clusterIP="10.0.0.1"), "10.0.0.1"),
    (
        "a Service of other pods",
        lambda d: only(d, "Service")["spec"].update(selector={"app": "voxelpiped"}),
        "Service: selects",
    ),
    (
        "a selector that misses its pods",
        lambda d: only(d, "Deployment")["spec"]["selector"].update(matchLabels={"app": "x"}),
        "Deployment: selects",
    ),
    (
        "a budget of other pods",
        lambda d: only(d, "PodDisruptionBudget")["spec"]["selector"].update(matchLabels={"app": "x"}),
        "PodDisruptionBudget: selects",
    ),
    (
        "a grace period shorter than lame duck and drain",
        lambda d: pod(d).update(terminationGracePeriodSeconds=40),
        "terminationGracePeriodSeconds: 40 is less than",
    ),
    (
        "a drain longer than the grace period",
        lambda d: set_argument(container(d), "--drain-grace-ms", "--drain-grace-ms=120000"),
        "drain 120",
    ),
    ("no preStop", lambda d: container(d).pop("lifecycle"), "preStop:"),
    (
        "readiness slower than the lame duck",
        lambda d: container(d)["readinessProbe"].update(periodSeconds=10),
        "only after its lame duck",
    ),
    ("a nervous liveness probe", lambda d: container(d)["livenessProbe"].update(failureThreshold=1), "one slow answer"),
    ("a hasty startup probe", lambda d: container(d)["startupProbe"].update(failureThreshold=5), "less than 30 s"),
    (
        "a missing limit of memory",
        lambda d: container(d)["resources"]["limits"].pop("memory"),
        "'memory' is a required",
    ),
    (
        "a request below the limit",
        lambda d: container(d)["resources"]["requests"].update(cpu="1"),
        "cpu: the request 1 is not the limit 4",
    ),
    ("half a core", lambda d: [part.update(cpu="500m") for part in container(d)["resources"].values()], "whole ones"),
    ("memory in megabits", lambda d: [part.update(memory="8Gb") for part in container(d)["resources"].values()], "8Gb"),
    (
        "too little memory",
        lambda d: [part.update(memory="512Mi") for part in container(d)["resources"].values()],
        "below 1 GiB",
    ),
    (
        "a GPU in the overlay without",
        lambda d: container(d)["resources"]["limits"].update({"nvidia.com/gpu": "1"}),
        "nvidia.com/gpu: 1 in the overlay cpu",
    ),
    ("root", lambda d: pod(d)["securityContext"].update(runAsNonRoot=False), "may run as root"),
    (
        "a writable root",
        lambda d: container(d)["securityContext"].update(readOnlyRootFilesystem=False),
        "write to its root",
    ),
    (
        "privileges",
        lambda d: container(d)["securityContext"]["capabilities"].update(drop=["NET_RAW"]),
        "gain privileges",
    ),
    ("variables of other services", lambda d: pod(d).update(enableServiceLinks=True), "enableServiceLinks"),
    ("a token of the cluster", lambda d: pod(d).update(automountServiceAccountToken=True), "token of the cluster"),
    (
        "a secret in a file",
        lambda d: d.append({"apiVersion": "v1", "kind": "Secret", "metadata": {"name": "x"}}),
        "Secret",
    ),
    ("a certificate that is not mounted", lambda d: container(d)["volumeMounts"].pop(0), "mounted are"),
    (
        "a key in another folder",
        lambda d: set_argument(container(d), "--tls-key", "--tls-key=/etc/tls/tls.key"),
        "/etc/tls/tls.key",
    ),
    (
        "a secret that all may read",
        lambda d: pod(d)["volumes"][0]["secret"].update(defaultMode=0o444),
        "others may read",
    ),
    ("calls without tokens", lambda d: set_argument(container(d), "--token-file", None), "--token-file: is missing"),
    ("a misspelt option", lambda d: container(d)["args"].append("--lame-duck=5"), "--lame-duck"),
    ("an option out of range", lambda d: container(d)["args"].append("--workers=5000"), "--workers"),
    (
        "a /tmp smaller than the exports",
        lambda d: pod(d)["volumes"][2]["emptyDir"].update(sizeLimit="1Gi"),
        "less than --export-bytes",
    ),
    (
        "a rollout that ends servers first",
        lambda d: only(d, "Deployment")["spec"]["strategy"]["rollingUpdate"].update(maxUnavailable=1),
        "ends servers before",
    ),
    ("replicas beside the autoscaler", lambda d: only(d, "Deployment")["spec"].update(replicas=3), "replicas"),
    ("no spread over zones", lambda d: pod(d)["topologySpreadConstraints"].pop(), "in one zone"),
    (
        "a budget that forbids every drain",
        lambda d: only(d, "PodDisruptionBudget")["spec"].update(maxUnavailable=0),
        "forbids every drain",
    ),
    ("no budget", lambda d: d.remove(only(d, "PodDisruptionBudget")), "without ['PodDisruptionBudget']"),
    (
        "scaling by a metric that does not exist",
        lambda d: only(d, "HorizontalPodAutoscaler")["spec"]["metrics"][0]["pods"]["metric"].update(
            name="queue_seconds"
        ),
        "queue_seconds is no metric",
    ),
    (
        "scaling of another Deployment",
        lambda d: only(d, "HorizontalPodAutoscaler")["spec"]["scaleTargetRef"].update(name="voxelpipe"),
        "not there",
    ),
    ("one server", lambda d: only(d, "HorizontalPodAutoscaler")["spec"].update(minReplicas=1), "fewer than two"),
    (
        "an open network",
        lambda d: only(d, "NetworkPolicy")["spec"]["ingress"][0]["from"][0].pop("podSelector"),
        "every pod of the cluster",
    ),
    ("open egress", lambda d: only(d, "NetworkPolicy")["spec"].update(egress=[{}]), "egress"),
    (
        "a policy for the wrong port",
        lambda d: only(d, "NetworkPolicy")["spec"]["ingress"][1]["ports"][0].update(port=9090),
        "NetworkPolicy: lets",
    ),
    (
        "an image without a version",
        lambda d: container(d).update(image="registry.example.org/voxelpipe:latest"),
        ":latest",
    ),
]

# For the overlay gpu.
GPU = [
    ("no GPU", lambda d: container(d)["resources"]["limits"].pop("nvidia.com/gpu"), "None in the overlay gpu"),
    ("no whole GPU", lambda d: container(d)["resources"]["limits"].update({"nvidia.com/gpu": "0.5"}), "0.5"),
    (
        "the image without device code",
        lambda d: container(d).update(image="registry.example.org/voxelpipe:0.1.0-cpu"),
        "0.1.0-cpu",
    ),
]

BATCH = [
    ("another number of shards than of indexes", lambda d: job(d).update(completions=16), "VOXELPIPE_SHARDS: 8"),
    (
        "a shard for all",
        lambda d: set_argument(container(d, "Job"), "--shard", "--shard=0/8"),
        "each index does the same",
    ),
    (
        "one report for all",
        lambda d: set_argument(container(d, "Job"), "--report", "--report=/data/report.json"),
        "all indexes write one file",
    ),
    ("not indexed", lambda d: job(d).pop("completionMode"), "one index that fails ends the others"),
    (
        "a limit for all indexes",
        lambda d: [job(d).pop("backoffLimitPerIndex"), job(d).update(backoffLimit=6)],
        "one index that fails ends the others",
    ),
    (
        "a misspelt limit",
        lambda d: rename(job(d), "backoffLimitPerIndex", "backOffLimitPerIndex"),
        "backOffLimitPerIndex",
    ),
    ("pods that restart in place", lambda d: pod(d, "Job").update(restartPolicy="OnFailure"), "restartPolicy"),
    (
        "permanent errors that are repeated",
        lambda d: drop_rule(d, lambda rule: rule.get("onExitCodes", {}).get("values") == [3]),
        "exit code 3 is retried",
    ),
    (
        "permanent errors that end all indexes",
        lambda d: job(d)["podFailurePolicy"]["rules"][0].update(action="FailJob"),
        "exit code 3 is FailJob",
    ),
    (
        "errors that pass and are not retried",
        lambda d: job(d)["podFailurePolicy"]["rules"][0]["onExitCodes"].update(values=[1, 3]),
        "exit code 1",
    ),
    (
        "drains that count as failures",
        lambda d: drop_rule(d, lambda rule: "onPodConditions" in rule),
        "drain of a node",
    ),
    (
        "a policy for no container",
        lambda d: job(d)["podFailurePolicy"]["rules"][0]["onExitCodes"].update(containerName="main"),
        "names ['batch', 'main']",
    ),
    ("a misspelt option of batch", lambda d: container(d, "Job")["args"].append("--resolutions=8"), "--resolutions"),
    (
        "results outside of the claim",
        lambda d: set_argument(container(d, "Job"), "--output-dir", "--output-dir=/results"),
        "in no volume",
    ),
    (
        "storage for one node",
        lambda d: only(d, "PersistentVolumeClaim")["spec"].update(accessModes=["ReadWriteOnce"]),
        "ReadWriteMany",
    ),
    (
        "another claim",
        lambda d: pod(d, "Job")["volumes"][0]["persistentVolumeClaim"].update(claimName="data"),
        "the pods claim",
    ),
    (
        "an aggregate of other reports",
        lambda d: aggregate(d).update(args=["voxelpipe aggregate /data/report.json --json"]),
        "the indexes write",
    ),
    (
        "a misspelt option of aggregate",
        lambda d: aggregate(d).update(args=["voxelpipe aggregate /data/reports/*.json --retry=/data/retry.jsonl"]),
        "aggregate has no --retry",
    ),
]
