"""The few features of kustomize that docker/kubernetes/ uses, for tests where there is no kubectl: `resources`,
`images`, and `patches` with a `path` (strategic merge). Anything else is an error, so that nothing is left out.
"""
import copy
import pathlib

import yaml

# How the lists of a patch are merged: by the key of their elements; other lists replace the old one.
MERGE_KEYS = {
    "containers": "name",
    "initContainers": "name",
    "env": "name",
    "volumes": "name",
    "volumeMounts": "mountPath",
    "ports": "containerPort",
}
HEADER = {"apiVersion": "kustomize.config.k8s.io/v1beta1", "kind": "Kustomization"}


def identity(document):
    return document["kind"], document["metadata"]["name"]


def read_documents(path):
    return [document for document in yaml.safe_load_all(path.read_text(encoding="utf-8")) if document is not None]


def merge(old, patch, name=""):
    """In: a value of a manifest, and the same place in a patch. Out: the value with the patch."""
    if isinstance(old, dict) and isinstance(patch, dict):
        merged = dict(old)
        for key, value in patch.items():
            merged[key] = merge(old[key], value, key) if key in old else copy.deepcopy(value)
        return merged
    key = MERGE_KEYS.get(name)
    if isinstance(old, list) and isinstance(patch, list) and key:
        merged = list(old)
        for element in patch:
            places = [i for i, one in enumerate(merged) if one[key] == element[key]]
            if places:
                merged[places[0]] = merge(merged[places[0]], element)
            else:
                merged.append(copy.deepcopy(element))
        return merged
    return copy.deepcopy(patch)


def pod_of(document):
    return document.get("spec", {}).get("template", {}).get("spec", {})


def set_images(documents, images):
    for image in images:
        unknown = set(image) - {"name", "newName", "newTag"}
        assert not unknown, f"images: {unknown}"
        for document in documents:
            for container in pod_of(document).get("containers", []):
                if container["image"].partition(":")[0] == image["name"]:
                    container["image"] = f"{image.get('newName', image['name'])}:{image['newTag']}"


def render(folder):
    """In: a folder with kustomization.yaml. Out: its manifests."""
    folder = pathlib.Path(folder)
    content = yaml.safe_load((folder / "kustomization.yaml").read_text(encoding="utf-8"))
    assert {key: content.pop(key) for key in HEADER} == HEADER, f"{folder}: not a kustomization"
    unknown = set(content) - {"resources", "images", "patches"}
    assert not unknown, f"{folder}: {unknown} is more than this renderer knows"
    documents = []
    for name in content["resources"]:
        path = folder / name
        documents += render(path) if path.is_dir() else read_documents(path)
    assert len({identity(document) for document in documents}) == len(documents), f"{folder}: two of one name"
    for patch in content.get("patches", []):
        assert set(patch) == {"path"}, f"{folder}: patches: {patch}"
        for change in read_documents(folder / patch["path"]):
            places = [i for i, document in enumerate(documents) if identity(document) == identity(change)]
            assert places, f"{folder}: {patch['path']} changes {identity(change)}, which is not there"
            documents[places[0]] = merge(documents[places[0]], change)
    set_images(documents, content.get("images", []))
    return documents
