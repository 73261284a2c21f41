#!/usr/bin/env bash
# Does the built wheel work where the checkout is not on the path? Run by `make wheel-smoke`
# and, step by step, by the Dockerfile:
#   install DIR [EXTRA]   new environment DIR with the wheel of this checkout in it, or with WHEEL
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
    "${pip[@]}" install -c "$root/constraints.txt" "${WHEEL:-$(build "$env")}${extra:+[$extra]}"
}

build() {
    rm -rf "$root/build" # setuptools would pack what it left there, deleted modules included
    "$1/bin/pip" -qq --disable-pip-version-check wheel --no-deps --wheel-dir "$1/wheel" "$root" >&2
    echo "$1"/wheel/world_translation-*.whl
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
    "$PYTHON" -m venv "$folder/builds"
    WHEEL=$(build "$folder/builds")
    export WHEEL
    # installing mostly waits: the environment with an extra beside those without
    (install "$folder/whole" fit; fit "$folder/whole" "$folder/fitted") > "$folder/whole.log" 2>&1 &
    local whole=$!
    for python in "$PYTHON" python3.13; do
        if ! "$python" -c 'import ensurepip' 2> /dev/null; then
            echo "SKIPPED: no $python on this machine"
            continue
        fi
        PYTHON=$python install "$folder/small"
        (diagnose "$folder/small" "$folder/diagnosed")
        rm -rf "$folder/small" "$folder/diagnosed"
    done
    wait "$whole" || fail "the wheel with the extra fit: $(tail -n 20 "$folder/whole.log")"
    tail -n 1 "$folder/whole.log"
}

PYTHON=${PYTHON:-python3}
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${@:-all}"
