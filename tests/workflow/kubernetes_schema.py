# SPDX-License-Identifier: Apache-2.0
"""Checks objects of Kubernetes by its published schema, from which the models of the package kubernetes are made."""

import re
from datetime import datetime
from typing import Any

from kubernetes import client

SCALARS = {"str": str, "bool": bool, "int": int, "float": (int, float)}


def faults_of(content: dict[str, Any]) -> list[str]:
    """What is wrong with an object: unknown and missing fields, other types than expected, values that the schema
    forbids. Each line has the path of the field."""
    group, _, version = str(content.get("apiVersion", "")).rpartition("/")
    kind = str(content.get("kind", ""))
    words = re.split(r"[.-]", group.removesuffix(".k8s.io") or "core")
    interface = getattr(client, "".join(word.capitalize() for word in (*words, version, "api")), None)
    creates = "create_(namespaced_)?" + re.sub(r"(?<=[a-z])(?=[A-Z])", "_", kind).lower()
    if interface is None or not any(re.fullmatch(creates, name) for name in dir(interface)):
        return [f"found the kind {kind} of {content.get('apiVersion')}, expected one of Kubernetes"]
    known = {key: value for key, value in content.items() if key != "status"}
    return _faults_of(known, version.capitalize() + kind, kind)


def _faults_of(value: Any, kind: str, path: str) -> list[str]:
    if match := re.fullmatch(r"list\[(.*)\]", kind):
        if not isinstance(value, list):
            return [f"{path}: found {value!r}, expected a list"]
        return [fault for k, item in enumerate(value) for fault in _faults_of(item, match[1], f"{path}[{k}]")]
    if match := re.fullmatch(r"dict\(str, (.*)\)", kind):
        if not isinstance(value, dict):
            return [f"{path}: found {value!r}, expected an object"]
        return [fault for key, item in value.items() for fault in _faults_of(item, match[1], f"{path}.{key}")]
    if kind in SCALARS:
        fits = isinstance(value, SCALARS[kind]) and (kind == "bool" or not isinstance(value, bool))
        return [] if fits else [f"{path}: found {value!r}, expected {kind}"]
    if kind == "object":
        return []
    if kind == "datetime":
        return [] if isinstance(value, (str, datetime)) else [f"{path}: found {value!r}, expected a time"]
    model = getattr(client, kind)
    if not isinstance(value, dict):
        return [f"{path}: found {value!r}, expected an object"]
    names = {json_name: name for name, json_name in model.attribute_map.items()}
    faults = [f"{path}.{key}: is no field of {kind}" for key in value if key not in names]
    known = {key: item for key, item in value.items() if key in names and item is not None}
    for key, item in known.items():
        faults += _faults_of(item, model.openapi_types[names[key]], f"{path}.{key}")
    try:
        model(**{names[key]: item for key, item in known.items()})
    except ValueError as error:  # a field that is missing, or a value that is forbidden
        faults.append(f"{path}: {error}")
    return faults
