"""LIF: every site that ships, by the official schema, by another reader, and back."""

from __future__ import annotations

import json
from collections.abc import Iterable

from benchmarks.harness import Row, Trial
from benchmarks.interop.others import instance, n_same, package
from maps.layouts.lif import write_lif
from maps.site import load_site, site_names


def measure_lif(trial: Trial) -> Iterable[Row]:
    """Write all sites, and read them back."""
    sites = [load_site(name) for name in site_names()]
    jsonschema = package("jsonschema", trial, "L1 schema")
    schema = instance("lif/LIF.schema", trial, "L1 schema")
    if jsonschema is not None and schema is not None:
        judge = jsonschema.Draft7Validator(json.loads(schema))
        errors = sum(len(list(judge.iter_errors(json.loads(write_lif(site))))) for site in sites)
        yield Row(name="L1 LIF, errors by the schema", value=errors, unit="", target="<= 0")
    parser = package("vdma_lif.parser", trial, "L1 another reader")
    if parser is not None:
        read = 0
        for site in sites:
            text = write_lif(site)
            again = json.loads(parser.LIFParser.to_json(parser.LIFParser.from_json(text)))
            read += again["layouts"] == json.loads(text)["layouts"]
        yield Row(name="L1 LIF, same by vdma-lif", value=read, unit="sites", target=f">= {len(sites)}")
    yield Row(name="L1 LIF, same lane graph", value=n_same("lif", sites), unit="sites", target=f">= {len(sites)}")
