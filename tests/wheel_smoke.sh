#!/usr/bin/env bash
# Does the built wheel work where the checkout is not on the path? Run by `make wheel-smoke`
# and, step by step, by the Dockerfile:
#   install DIR   new environment DIR with the wheel of this checkout in it
#   run DIR OUT   smoke test with DIR's `wt`: help, then the debug fit, its files in OUT
# Without arguments: both, in a temporary folder.
set -euo pipefail
root=$(cd "$(dirname "$0")/.." && pwd)

install() {
    local env=$1
    "${PYTHON:-python3}" -m venv "$env"
    local pip=("$env/bin/pip" -qq --disable-pip-version-check)
    "${pip[@]}" install "$(grep '^torch==' "$root/constraints.txt")"
    rm -rf "$root/build" # setuptools would pack what it left there, deleted modules included
    "${pip[@]}" wheel --no-deps --wheel-dir "$env/wheel" "$root"
    "${pip[@]}" install -c "$root/constraints.txt" "$(echo "$env"/wheel/world_translation-*.whl)[fit]"
}

run() {
    local wt=$1/bin/wt out=$2
    mkdir -p "$out"
    cd "$out" # away from the checkout, so that only the wheel can be imported
    "$wt" --help
    "$wt" fit --config debug --out run # conf/debug.yaml inside the wheel
    "$wt" model go2 > go2.xml
    "$1/bin/python" -c 'from wt import shipped; print(*sorted(shipped.folder("examples").glob("*/model.xml")))' |
        grep -q arm/model.xml
    for file in results.json results.md rollout.rrd model.onnx card.json config.yaml; do
        test -s "run/$file" || { echo "error: the run left no $file" >&2; exit 1; }
    done
    echo "wheel smoke test passed"
}

if [ $# -gt 0 ]; then
    "$@"
else
    folder=$(mktemp -d)
    trap 'rm -rf "$folder"' EXIT
    install "$folder/env"
    (run "$folder/env" "$folder/out")
fi
