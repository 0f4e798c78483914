#!/bin/sh
# For any other CI: run it in your driver's folder. pip installs TACTEMU: a version, a wheel, or git+https://....
set -eu
python3 -m venv .tactile
.tactile/bin/python -m pip install --quiet "${TACTEMU:-tactemu}" pytest pytest-timeout
exec .tactile/bin/python -m pytest --timeout 60 --tactemu-truth-dir tactemu-failed "$@"
