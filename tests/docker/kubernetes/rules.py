"""What the manifests of docker/kubernetes/ promise beyond their schemas: the parts fit each other and the programs.
Each rule is a function of a Deck; it gives texts that name what is wrong, none if nothing is.
"""
import math
import re
import shlex

END_S = 10  # what a server takes beyond lame duck and grace (server/main.cpp)
SCALES = {
    "": 1,
    "m": 1e-3,
    "k": 1e3,
    "M": 1e6,
    "G": 1e9,
    "T": 1e12,
    "Ki": 2**10,
    "Mi": 2**20,
    "Gi": 2**30,
    "Ti": 2**40,
}


def quantity(text):
    number, scale = re.fullmatch(r"([0-9.]+)([a-zA-Z]*)", text).groups()
    return float(number) * SCALES[scale]


class Deck:
    """The manifests of one overlay, with what the rules ask of them."""

    def __init__(self, documents, gpu, facts):
        """facts: {"version", "metrics" (names), "options" ({flag: value} of the arguments of the server)}"""
        self.documents, self.gpu, self.facts = documents, gpu, facts

    def kinds(self, kind):
        return [document for document in self.documents if document["kind"] == kind]

    def workloads(self):
        """Triples of a manifest, its pod and its one container."""
        for document in self.documents:
            if document["kind"] in ("Deployment", "Job"):
                pod = document["spec"]["template"]["spec"]
                yield document, pod, pod["containers"][0]

    def server(self):
        return next(
            ((pod, container) for document, pod, container in self.workloads() if document["kind"] == "Deployment"),
            (None, None),
        )


def words_of(container):
    """The program, and its arguments; a shell's are those of its one command."""
    if container.get("command") == ["sh", "-c"]:
        return shlex.split(container["args"][0].removeprefix("exec "))
    return [*container.get("command", ["voxelpiped"]), *container["args"]]  # that of the image


def options_of(container):
    """{flag: value} of arguments --flag=value."""
    return dict(word.split("=", 1) for word in words_of(container) if word.startswith("--") and "=" in word)


def port_number(container, port):
    """Of a name or a number; None if the container does not open it."""
    for opened in container.get("ports", []):
        if port in (opened["name"], opened["containerPort"]):
            return opened["containerPort"]
    return None


def labels_fit(deck):
    for document in deck.documents:
        spec = document.get("spec", {})
        if "template" not in spec:
            continue
        labels = spec["template"]["metadata"]["labels"].items()
        wanted = [spec["selector"]["matchLabels"]] if "selector" in spec else []
        wanted += [
            spread["labelSelector"]["matchLabels"]
            for spread in spec["template"]["spec"].get("topologySpreadConstraints", [])
        ]
        for selector in wanted:
            if not selector.items() <= labels:
                yield f"{document['kind']}: selects {selector}, its pods are {dict(labels)}"
    servers = [document["spec"]["template"]["metadata"]["labels"] for document in deck.kinds("Deployment")]
    for kind, get in (
        ("Service", lambda spec: spec["selector"]),
        ("PodDisruptionBudget", lambda spec: spec["selector"]["matchLabels"]),
        ("NetworkPolicy", lambda spec: spec["podSelector"]["matchLabels"]),
    ):
        for document in deck.kinds(kind):
            if not any(get(document["spec"]).items() <= labels.items() for labels in servers):
                yield f"{kind}: selects {get(document['spec'])}, which no pod has"


def ports_are_the_servers(deck):
    _, container = deck.server()
    if container is None:
        return
    listens = {
        name: int(deck.facts["options"][flag].rpartition(":")[2])
        for name, flag in (("grpc", "--listen"), ("http", "--http-listen"))
    }
    for name, number in listens.items():
        if port_number(container, name) != number:
            yield f"port {name}: the container opens {port_number(container, name)}, the server listens at {number}"
    for flag in ("--listen", "--http-listen"):
        if not deck.facts["options"][flag].startswith("0.0.0.0:"):
            yield f"{flag}: other pods cannot reach {deck.facts['options'][flag]}"
    for probe, path in (("startupProbe", "/readyz"), ("readinessProbe", "/readyz"), ("livenessProbe", "/livez")):
        if probe not in container:
            yield f"{probe}: is missing"
            continue
        get = container[probe]["httpGet"]
        if port_number(container, get["port"]) != listens["http"]:
            yield f"{probe}: asks at port {get['port']}, /readyz and /livez are at {listens['http']}"
        if get["path"] != path:
            yield f"{probe}: asks for {get['path']}, not {path}"
        if get.get("scheme", "HTTP") != "HTTP":
            yield f"{probe}: the port has no TLS"
    for service in deck.kinds("Service"):
        for port in service["spec"]["ports"]:
            if port_number(container, port["targetPort"]) != port["port"]:
                yield f"Service: port {port['name']} leads to {port['targetPort']}, which is not {port['port']}"
        if not {"grpc", "http"} <= {port["name"] for port in service["spec"]["ports"]}:
            yield "Service: lacks the port of calls or of metrics"
    for policy in deck.kinds("NetworkPolicy"):
        opened = {port_number(container, port["port"]) for rule in policy["spec"]["ingress"] for port in rule["ports"]}
        if opened != set(listens.values()):
            yield f"NetworkPolicy: lets {opened} in, the server listens at {set(listens.values())}"


def times_are_in_step(deck):
    pod, container = deck.server()
    if container is None:
        return
    sleep = container.get("lifecycle", {}).get("preStop", {}).get("sleep", {}).get("seconds", 0)
    if sleep == 0:
        yield "preStop: SIGTERM comes before the pod's address has left the Service"
    lame_duck = int(deck.facts["options"]["--lame-duck-ms"]) / 1000
    drain = int(deck.facts["options"]["--drain-grace-ms"]) / 1000
    need = sleep + lame_duck + drain + END_S
    if pod["terminationGracePeriodSeconds"] < need:
        yield (
            f"terminationGracePeriodSeconds: {pod['terminationGracePeriodSeconds']} is less than preStop {sleep}, "
            f"lame duck {lame_duck:g}, drain {drain:g} and {END_S} s for the end"
        )
    ready = container.get("readinessProbe")
    if ready and ready["periodSeconds"] * ready["failureThreshold"] > lame_duck:
        yield "readinessProbe: sees the end of the server only after its lame duck"
    start = container.get("startupProbe")
    if start and start["periodSeconds"] * start["failureThreshold"] < 30:
        yield "startupProbe: less than 30 s for the start"
    live = container.get("livenessProbe")
    if live and live["failureThreshold"] < 3:
        yield "livenessProbe: one slow answer ends a server and all its calls"


def limits_are_complete(deck):
    for document, _, container in deck.workloads():
        requests, limits = container["resources"]["requests"], container["resources"]["limits"]
        where = document["metadata"]["name"]
        # The server derives threads and budgets from its limits; what is beyond the request may be taken from it.
        for name in ("cpu", "memory"):
            if requests.get(name) != limits.get(name):
                yield f"{where}: {name}: the request {requests.get(name)} is not the limit {limits.get(name)}"
        if quantity(limits.get("cpu", "0")) != math.ceil(quantity(limits.get("cpu", "0"))):
            yield f"{where}: cpu: {limits['cpu']}: threads are whole ones"
        if quantity(limits.get("memory", "0")) < 2**30:
            yield f"{where}: memory: {limits.get('memory')} is below 1 GiB, from which the default budgets fit"
        works = document["metadata"]["name"] != "voxelpipe-aggregate"
        if ("nvidia.com/gpu" in limits) != (deck.gpu and works):
            overlay = "gpu" if deck.gpu else "cpu"
            yield f"{where}: nvidia.com/gpu: {limits.get('nvidia.com/gpu')} in the overlay {overlay}"


def pods_may_do_little(deck):
    for document, pod, container in deck.workloads():
        where, context = document["metadata"]["name"], container["securityContext"]
        if pod["automountServiceAccountToken"] or any(
            one["automountServiceAccountToken"] for one in deck.kinds("ServiceAccount")
        ):
            yield f"{where}: has a token of the cluster"
        if pod["enableServiceLinks"]:
            yield f"{where}: enableServiceLinks: names of services become variables of options"
        if not pod["securityContext"]["runAsNonRoot"]:
            yield f"{where}: may run as root"
        if context["allowPrivilegeEscalation"] or context["capabilities"]["drop"] != ["ALL"]:
            yield f"{where}: may gain privileges"
        if not context["readOnlyRootFilesystem"]:
            yield f"{where}: can write to its root"
    if any(document["kind"] == "Secret" for document in deck.documents):
        yield "Secret: belongs into no file"
    for policy in deck.kinds("NetworkPolicy"):
        if policy["spec"]["egress"] or set(policy["spec"]["policyTypes"]) != {"Ingress", "Egress"}:
            yield "NetworkPolicy: the server opens no connection; egress is to be closed"
        if any(
            "podSelector" not in peer and "matchLabels" not in peer["namespaceSelector"]
            for rule in policy["spec"]["ingress"]
            for peer in rule["from"]
        ):
            yield "NetworkPolicy: lets every pod of the cluster in"


def files_are_mounted(deck):
    for document, pod, container in deck.workloads():
        where = document["metadata"]["name"]
        volumes = {volume["name"]: volume for volume in pod["volumes"]}
        mounts = {mount["mountPath"]: mount for mount in container["volumeMounts"]}
        if {mount["name"] for mount in mounts.values()} != set(volumes):
            yield f"{where}: volumes {sorted(volumes)}, mounted are {sorted(m['name'] for m in mounts.values())}"
            continue
        for argument in words_of(container)[1:]:
            path = argument.rpartition("=")[2]
            if path.startswith("/") and not any(path.startswith(mount + "/") for mount in mounts):
                yield f"{where}: {argument}: in no volume"
        for mount in mounts.values():
            volume = volumes[mount["name"]]
            if "secret" in volume and not mount.get("readOnly"):
                yield f"{where}: {mount['name']}: a secret that is not read-only"
            if "secret" in volume and volume["secret"]["defaultMode"] & 0o037:
                yield f"{where}: {mount['name']}: a secret that others may read"
        if document["kind"] == "Deployment":
            files = volumes.get(mounts.get("/tmp", {}).get("name"), {}).get("emptyDir", {})
            need = int(deck.facts["options"]["--export-bytes"])
            if quantity(files.get("sizeLimit", "0")) < need:
                yield f"{where}: /tmp: {files.get('sizeLimit')} is less than --export-bytes, {need}"
            for flag in ("--tls-cert", "--tls-key", "--token-file"):
                if flag not in options_of(container):
                    yield f"{where}: {flag}: is missing; without it every pod may read or call"


def rollouts_and_drains_lose_nothing(deck):
    for deployment in deck.kinds("Deployment"):
        rolling = deployment["spec"]["strategy"]["rollingUpdate"]
        if rolling["maxUnavailable"] != 0 or rolling["maxSurge"] < 1:
            yield "Deployment: a rollout ends servers before new ones serve"
        if "replicas" in deployment["spec"] and deck.kinds("HorizontalPodAutoscaler"):
            yield "Deployment: replicas: each apply would undo the autoscaler's number"
        spreads = {
            spread["topologyKey"]
            for spread in deployment["spec"]["template"]["spec"].get("topologySpreadConstraints", [])
        }
        if not {"kubernetes.io/hostname", "topology.kubernetes.io/zone"} <= spreads:
            yield "Deployment: servers may all be on one node or in one zone"
        needed = {"Service", "PodDisruptionBudget", "HorizontalPodAutoscaler", "NetworkPolicy"}
        missing = needed - {document["kind"] for document in deck.documents}
        if missing:
            yield f"Deployment: without {sorted(missing)}"
    for scaler in deck.kinds("HorizontalPodAutoscaler"):
        spec = scaler["spec"]
        names = [deployment["metadata"]["name"] for deployment in deck.kinds("Deployment")]
        if spec["scaleTargetRef"]["name"] not in names:
            yield f"HorizontalPodAutoscaler: scales {spec['scaleTargetRef']['name']}, which is not there"
        if not 2 <= spec["minReplicas"] <= spec["maxReplicas"]:
            yield "HorizontalPodAutoscaler: fewer than two servers, or a maximum below the minimum"
        for metric in spec["metrics"]:
            if metric["pods"]["metric"]["name"] not in deck.facts["metrics"]:
                yield f"HorizontalPodAutoscaler: {metric['pods']['metric']['name']} is no metric of the server"
        for budget in deck.kinds("PodDisruptionBudget"):
            if not 1 <= budget["spec"]["maxUnavailable"] < spec["minReplicas"]:
                yield "PodDisruptionBudget: forbids every drain, or allows all servers to go at once"


def images_are_pinned(deck):
    for document, _, container in deck.workloads():
        name, _, tag = container["image"].rpartition(":")
        target = "cuda" if deck.gpu else "cpu"
        if "/" not in name or tag != f"{deck.facts['version']}-{target}":
            yield f"{document['metadata']['name']}: image {container['image']}, not REGISTRY/voxelpipe:VERSION-{target}"


def actions(job):
    """{exit code or condition: action} of the pod failure policy, and the containers that it names."""
    found, named = {}, set()
    for rule in job["spec"]["podFailurePolicy"]["rules"]:
        if "onExitCodes" in rule:
            named.add(rule["onExitCodes"]["containerName"])
            if rule["onExitCodes"]["operator"] == "In":
                found.update({code: rule["action"] for code in rule["onExitCodes"]["values"]})
        else:
            found.update(
                {
                    condition["type"]: rule["action"]
                    for condition in rule["onPodConditions"]
                    if condition["status"] == "True"
                }
            )
    return found, named


def jobs_end_as_they_should(deck):
    for job, pod, container in deck.workloads():
        if job["kind"] != "Job":
            continue
        where, spec = job["metadata"]["name"], job["spec"]
        found, named = actions(job)
        if pod.get("restartPolicy") != "Never":
            yield f"{where}: restartPolicy: a pod failure policy needs Never"
        if named != {container["name"]}:
            yield f"{where}: podFailurePolicy: names {sorted(named)}, the container is {container['name']}"
        if found.get("DisruptionTarget") != "Ignore":
            yield f"{where}: podFailurePolicy: a drain of a node counts as a failure"
        indexed = spec.get("completionMode") == "Indexed"
        if found.get(3) != ("FailIndex" if indexed else "FailJob"):
            yield f"{where}: podFailurePolicy: exit code 3 is {found.get(3, 'retried')}: permanent errors are repeated"
        if found.get(2) != "FailJob":
            yield f"{where}: podFailurePolicy: exit code 2 is {found.get(2, 'retried')}: a usage error is repeated"
        if 1 in found:
            yield f"{where}: podFailurePolicy: exit code 1 is not retried"
        if "ttlSecondsAfterFinished" not in spec:
            yield f"{where}: ttlSecondsAfterFinished: stays for ever"
        if words_of(container)[1] == "batch":
            if not indexed or "backoffLimitPerIndex" not in spec or "backoffLimit" in spec:
                yield f"{where}: completionMode, backoffLimitPerIndex: one index that fails ends the others"
            shards = {one["name"]: one["value"] for one in container.get("env", [])}.get("VOXELPIPE_SHARDS")
            if shards != str(spec.get("completions")):
                yield f"{where}: VOXELPIPE_SHARDS: {shards}, completions: {spec.get('completions')}"
            if spec.get("parallelism", 0) > spec.get("completions", 0):
                yield f"{where}: parallelism: more than there are indexes"
            options = options_of(container)
            if options.get("--shard") != "auto":
                yield f"{where}: --shard: each index does the same"
            if "$(JOB_COMPLETION_INDEX)" not in options.get("--report", ""):
                yield f"{where}: --report: all indexes write one file"
        if not any("persistentVolumeClaim" in volume for volume in pod["volumes"]):
            yield f"{where}: no claim of storage: the results go with the pod"


def claims_are_shared(deck):
    for claim in deck.kinds("PersistentVolumeClaim"):
        if claim["spec"]["accessModes"] != ["ReadWriteMany"]:
            yield "PersistentVolumeClaim: indexes on several nodes write into it: ReadWriteMany"
        claims = {
            volume["persistentVolumeClaim"]["claimName"]
            for _, pod, _ in deck.workloads()
            for volume in pod["volumes"]
            if "persistentVolumeClaim" in volume
        }
        if claims != {claim["metadata"]["name"]}:
            yield f"PersistentVolumeClaim: {claim['metadata']['name']}, the pods claim {sorted(claims)}"


def reports_are_those_of_the_batch(deck):
    """Of an overlay of the batch together with its aggregate."""
    containers = {words_of(container)[1]: (pod, container) for _, pod, container in deck.workloads()}
    if not {"batch", "aggregate"} <= set(containers):
        return
    pod, batch = containers["batch"]
    other_pod, aggregate = containers["aggregate"]
    written = options_of(batch).get("--report", "").rpartition("/")[0] + "/*.json"
    read = [word for word in words_of(aggregate)[2:] if not word.startswith("--")]
    if read != [written]:
        yield f"voxelpipe-aggregate: reads {read}, the indexes write {written}"
    if pod["volumes"] != other_pod["volumes"] or batch["volumeMounts"] != aggregate["volumeMounts"]:
        yield "voxelpipe-aggregate: has other volumes than the batch"


RULES = [
    labels_fit,
    ports_are_the_servers,
    times_are_in_step,
    limits_are_complete,
    pods_may_do_little,
    files_are_mounted,
    rollouts_and_drains_lose_nothing,
    images_are_pinned,
    jobs_end_as_they_should,
    claims_are_shared,
    reports_are_those_of_the_batch,
]


def problems(deck):
    """Texts, each with the name of its rule."""
    return [f"{rule.__name__}: {text}" for rule in RULES for text in rule(deck)]
