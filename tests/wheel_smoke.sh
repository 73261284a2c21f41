#!/usr/bin/env bash
# Does the built wheel work where the checkout is not on the path? Run by `make wheel-smoke`
# and, step by step, by the Dockerfile:
#   install DIR [EXTRA]   new environment DIR with the wheel of this checkout in it
#   diagnose DIR OUT      without an extra: under a gigabyte, and finds what an example hides
#   fit DIR OUT           with the extra fit: the debug fit, its files in OUT
# Without arguments: all of them in a temporary folder, the first two for Python 3.13 as well.
set -euo pipefail
root=$(cd "$(dirname "$0")/.." && pwd)

fail() { echo "error: $1" >&2; exit 1; }

install() {
    local env=$1 extra=${2:-}
    "$PYTHON" -m venv "$env"
    local pip=("$env/bin/pip" -qq --disable-pip-version-check)
    if [ -n "$extra" ]; then "${pip[@]}" install "$(grep '^torch==' "$root/constraints.txt")"; fi
    rm -rf "$root/build" # setuptools would pack what it left there, deleted modules included
    "${pip[@]}" wheel --no-deps --wheel-dir "$env/wheel" "$root"
    "${pip[@]}" install -c "$root/constraints.txt" \
        "$(echo "$env"/wheel/world_translation-*.whl)${extra:+[$extra]}"
}

diagnose() {
    local wt=$1/bin/wt out=$2 size examples
    size=$(du --summarize --block-size=1 "$1" | cut -f1) # with all bytecode, and pip itself
    [ "$size" -lt 1000000000 ] || fail "$((size / 1000000)) MB are installed without an extra"
    mkdir -p "$out"
    cd "$out" # away from the checkout, so that only the wheel can be imported
    "$wt" --help > /dev/null
    examples=$("$1/bin/python" -c 'from wt import shipped; print(shipped.folder("examples"))')
    "$wt" diagnose "$examples/cart/model.xml" "$examples"/cart/*.parquet --out cart
    grep -q '"joint.friction_coulomb"' cart/diagnosis.json || fail "the cart's friction is not found"
    echo "wheel without an extra: passed, $((size / 1000000)) MB, $("$1/bin/python" --version)"
}

fit() {
    local wt=$1/bin/wt out=$2
    mkdir -p "$out"
    cd "$out"
    "$wt" fit --config debug --out run # conf/debug.yaml inside the wheel
    "$wt" model go2 > go2.xml
    for file in results.json results.md rollout.rrd model.onnx card.json config.yaml; do
        test -s "run/$file" || fail "the run left no $file"
    done
    echo "wheel with the extra fit: passed"
}

all() {
    local python
    # pyenv answers to the name of a version only if it is told to
    if command -v pyenv > /dev/null; then
        PYENV_VERSION=$(pyenv versions --bare | sort -rV | paste -sd:)
        export PYENV_VERSION
    fi
    for python in "$PYTHON" python3.13; do
        if ! "$python" -c 'import ensurepip' 2> /dev/null; then
            echo "SKIPPED: no $python on this machine"
            continue
        fi
        PYTHON=$python install "$folder/small"
        (diagnose "$folder/small" "$folder/diagnosed")
        rm -rf "$folder/small" "$folder/diagnosed"
    done
    install "$folder/whole" fit
    (fit "$folder/whole" "$folder/fitted")
}

PYTHON=${PYTHON:-python3}
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${@:-all}"
