"""check_schema.py SCHEMA FILE...: which of the YAML files fit a JSON schema; exit code 0 if all do, 1 if not."""

import json
import sys

import jsonschema
import yaml

with open(sys.argv[1], encoding="utf-8") as file:
    schema = json.load(file)
jsonschema.Draft7Validator.check_schema(schema)
validator = jsonschema.Draft7Validator(schema)
all_fit = True
for name in sys.argv[2:]:
    with open(name, encoding="utf-8") as file:
        mistakes = [f"{'.'.join(map(str, e.path))}: {e.message}" for e in validator.iter_errors(yaml.safe_load(file))]
    print(f"{name}: {'; '.join(mistakes) or 'fits'}")
    all_fit = all_fit and not mistakes
sys.exit(0 if all_fit else 1)
