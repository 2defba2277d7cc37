"""Closed schemas of the manifests in docker/kubernetes/: what is not named here is refused, so that a misspelt field
is. Only the fields that the manifests use, as Kubernetes 1.34 defines them; a new field is added here with its type.
"""
import jsonschema

TEXT = {"type": "string", "minLength": 1}
NAME = {"type": "string", "pattern": "^[a-z0-9]([-a-z0-9]{0,61}[a-z0-9])?$"}
BOOL = {"type": "boolean"}
NATURAL = {"type": "integer", "minimum": 0}
POSITIVE = {"type": "integer", "minimum": 1}
PORT = {"type": "integer", "minimum": 1, "maximum": 65535}
PORT_OR_NAME = {"anyOf": [PORT, NAME]}
# Cores and bytes are texts, since a number with a fraction is read differently from what is written.
QUANTITY = {"type": "string", "pattern": "^[0-9]+(\\.[0-9]+)?(m|k|M|G|T|Ki|Mi|Gi|Ti)?$"}
LABELS = {"type": "object", "additionalProperties": {"type": "string"}, "minProperties": 1}


def choice(*values):
    return {"enum": list(values)}


def array(items, least=1):
    return {"type": "array", "items": items, "minItems": least}


def closed(required, optional=None):
    """An object with these fields and no other."""
    return {
        "type": "object",
        "properties": {**required, **(optional or {})},
        "required": list(required),
        "additionalProperties": False,
    }


SELECTOR = closed({"matchLabels": LABELS})
EMPTY = closed({})
METADATA = closed({"name": NAME}, {"labels": LABELS})

HTTP_PROBE = closed(
    {
        "httpGet": closed(
            {"path": {"type": "string", "pattern": "^/"}, "port": PORT_OR_NAME}, {"scheme": choice("HTTP", "HTTPS")}
        ),
        "periodSeconds": POSITIVE,
        "timeoutSeconds": POSITIVE,
        "failureThreshold": POSITIVE,
    },
    {"initialDelaySeconds": NATURAL, "successThreshold": POSITIVE},
)
RESOURCES = closed(
    {"cpu": QUANTITY, "memory": QUANTITY}, {"nvidia.com/gpu": {"type": "string", "pattern": "^[1-9][0-9]*$"}}
)
CONTAINER = closed(
    {
        "name": NAME,
        "image": TEXT,
        "args": array(TEXT),
        "resources": closed({"requests": RESOURCES, "limits": RESOURCES}),
        "securityContext": closed(
            {
                "allowPrivilegeEscalation": BOOL,
                "readOnlyRootFilesystem": BOOL,
                "capabilities": closed({"drop": array(TEXT)}),
            }
        ),
        "volumeMounts": array(
            closed({"name": NAME, "mountPath": {"type": "string", "pattern": "^/"}}, {"readOnly": BOOL})
        ),
    },
    {
        "command": array(TEXT),
        "env": array(closed({"name": {"type": "string", "pattern": "^[A-Z_]+$"}, "value": {"type": "string"}})),
        "ports": array(closed({"name": NAME, "containerPort": PORT}, {"protocol": choice("TCP")})),
        "startupProbe": HTTP_PROBE,
        "readinessProbe": HTTP_PROBE,
        "livenessProbe": HTTP_PROBE,
        "lifecycle": closed({"preStop": closed({"sleep": closed({"seconds": POSITIVE})})}),
    },
)
VOLUME = {
    "oneOf": [
        closed({"name": NAME, "secret": closed({"secretName": NAME, "defaultMode": NATURAL})}),
        closed({"name": NAME, "emptyDir": closed({"sizeLimit": QUANTITY})}),
        closed({"name": NAME, "persistentVolumeClaim": closed({"claimName": NAME}, {"readOnly": BOOL})}),
    ]
}
SPREAD = closed(
    {
        "maxSkew": POSITIVE,
        "topologyKey": TEXT,
        "whenUnsatisfiable": choice("DoNotSchedule", "ScheduleAnyway"),
        "labelSelector": SELECTOR,
    },
    {"matchLabelKeys": array(TEXT)},
)
POD = closed(
    {
        "automountServiceAccountToken": BOOL,
        "enableServiceLinks": BOOL,
        "terminationGracePeriodSeconds": POSITIVE,
        "securityContext": closed(
            {
                "runAsNonRoot": BOOL,
                "runAsUser": POSITIVE,
                "runAsGroup": POSITIVE,
                "fsGroup": POSITIVE,
                "seccompProfile": closed({"type": choice("RuntimeDefault")}),
            }
        ),
        "containers": array(CONTAINER),
        "volumes": array(VOLUME),
    },
    {
        "serviceAccountName": NAME,
        "nodeSelector": LABELS,
        "restartPolicy": choice("Always", "OnFailure", "Never"),
        "topologySpreadConstraints": array(SPREAD),
        "tolerations": array(closed({"key": TEXT, "operator": choice("Exists"), "effect": choice("NoSchedule")})),
    },
)
TEMPLATE = closed({"metadata": closed({"labels": LABELS}), "spec": POD})

# A rule has an action and exactly one of two conditions.
ACTION = choice("FailJob", "FailIndex", "Ignore", "Count")
EXIT_CODES = closed({"containerName": NAME, "operator": choice("In", "NotIn"), "values": array(NATURAL)})
FAILURE_RULE = {
    "oneOf": [
        closed({"action": ACTION, "onExitCodes": EXIT_CODES}),
        closed({"action": ACTION, "onPodConditions": array(closed({"type": TEXT, "status": choice("True", "False")}))}),
    ]
}
SCALING_POLICIES = closed(
    {
        "stabilizationWindowSeconds": NATURAL,
        "policies": array(closed({"type": choice("Pods", "Percent"), "value": POSITIVE, "periodSeconds": POSITIVE})),
    }
)
PEER = closed({"namespaceSelector": {"anyOf": [EMPTY, SELECTOR]}}, {"podSelector": SELECTOR})

SPECS = {
    ("apps/v1", "Deployment"): closed(
        {
            "selector": SELECTOR,
            "template": TEMPLATE,
            "strategy": closed(
                {
                    "type": choice("RollingUpdate"),
                    "rollingUpdate": closed({"maxUnavailable": NATURAL, "maxSurge": NATURAL}),
                }
            ),
        },
        {"replicas": NATURAL, "revisionHistoryLimit": NATURAL, "minReadySeconds": NATURAL},
    ),
    ("v1", "Service"): closed(
        {
            "clusterIP": choice("None"),
            "selector": LABELS,
            "ports": array(closed({"name": NAME, "port": PORT, "targetPort": PORT_OR_NAME})),
        }
    ),
    ("policy/v1", "PodDisruptionBudget"): closed(
        {"maxUnavailable": NATURAL, "selector": SELECTOR},
        {"unhealthyPodEvictionPolicy": choice("AlwaysAllow", "IfHealthyBudget")},
    ),
    ("autoscaling/v2", "HorizontalPodAutoscaler"): closed(
        {
            "scaleTargetRef": closed({"apiVersion": choice("apps/v1"), "kind": choice("Deployment"), "name": NAME}),
            "minReplicas": POSITIVE,
            "maxReplicas": POSITIVE,
            "metrics": array(
                closed(
                    {
                        "type": choice("Pods"),
                        "pods": closed(
                            {
                                "metric": closed({"name": TEXT}),
                                "target": closed({"type": choice("AverageValue"), "averageValue": QUANTITY}),
                            }
                        ),
                    }
                )
            ),
        },
        {"behavior": closed({"scaleUp": SCALING_POLICIES, "scaleDown": SCALING_POLICIES})},
    ),
    ("networking.k8s.io/v1", "NetworkPolicy"): closed(
        {
            "podSelector": SELECTOR,
            "policyTypes": array(choice("Ingress", "Egress")),
            "egress": array({}, least=0),
            "ingress": array(
                closed({"from": array(PEER), "ports": array(closed({"protocol": choice("TCP"), "port": PORT_OR_NAME}))})
            ),
        }
    ),
    ("v1", "PersistentVolumeClaim"): closed(
        {
            "accessModes": array(choice("ReadWriteMany", "ReadWriteOnce", "ReadOnlyMany")),
            "resources": closed({"requests": closed({"storage": QUANTITY})}),
        },
        {"storageClassName": NAME},
    ),
    ("batch/v1", "Job"): closed(
        {"template": TEMPLATE, "podFailurePolicy": closed({"rules": array(FAILURE_RULE)})},
        {
            "completionMode": choice("Indexed", "NonIndexed"),
            "completions": POSITIVE,
            "parallelism": POSITIVE,
            "backoffLimit": NATURAL,
            "backoffLimitPerIndex": NATURAL,
            "ttlSecondsAfterFinished": NATURAL,
        },
    ),
}
WHOLE = {
    (version, kind): closed({"apiVersion": choice(version), "kind": choice(kind), "metadata": METADATA, "spec": spec})
    for (version, kind), spec in SPECS.items()
}
WHOLE["v1", "ServiceAccount"] = closed(
    {
        "apiVersion": choice("v1"),
        "kind": choice("ServiceAccount"),
        "metadata": METADATA,
        "automountServiceAccountToken": BOOL,
    }
)


def problems(document):
    """Texts, each with the place in the manifest."""
    kind = document.get("apiVersion"), document.get("kind")
    if kind not in WHOLE:
        return [f"schema: no manifest of {kind[1]} has the version {kind[0]}"]
    found = []
    for error in jsonschema.Draft7Validator(WHOLE[kind]).iter_errors(document):
        # Of alternatives, the one that fits best says most.
        error = jsonschema.exceptions.best_match([error])
        place = "/".join(str(step) for step in error.absolute_path)
        found.append(f"schema: {kind[1]}: {place}: {error.message}")
    return found
