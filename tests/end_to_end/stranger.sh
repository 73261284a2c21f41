#!/usr/bin/env bash
# What a stranger does first: clone, make demo, open each product. Run by `make stranger`.
# Takes about six minutes on two cores, most of them for installing; set KEEP to a folder to keep
# what it made, and STRANGER_VENV to an environment to use instead of installing one.
set -euo pipefail
root=$(cd "$(dirname "$0")/../.." && pwd)
home=${KEEP:-$(mktemp -d)}
[ -n "${KEEP:-}" ] || trap 'rm -rf "$home"' EXIT
mkdir -p "$home"
began=$SECONDS

git clone --quiet "$root" "$home/clone"
cd "$home/clone"
if [ -n "${STRANGER_VENV:-}" ]; then
    ln -s "$STRANGER_VENV" .venv && export PYTHONPATH=$PWD
    touch -r .venv/.installed pyproject.toml constraints.txt # or make would install this clone there
    bin=.venv/bin
else
    make env
    bin=.venv/bin
fi
set_up=$SECONDS
make demo
echo "set-up took $((set_up - began)) s, the demonstration $((SECONDS - set_up)) s"

fail() { echo "error: $1" >&2; exit 1; }
for name in arm cart; do
    grep -q '</html>' "demo/$name/report.html" || fail "$name: the report is not whole"
    $bin/python -c 'import mujoco, sys; mujoco.MjModel.from_xml_path(sys.argv[1])' "demo/$name/model.xml"
    $bin/rerun rrd verify "demo/$name/diagnosis.rrd" > /dev/null
    hidden=$($bin/python -c 'import json, sys; print(json.load(open(sys.argv[1]))["truth"][0]["effect"])' \
        "demo/examples/$name/answer.json")
    grep -q "\"$hidden\"" "demo/$name/diagnosis.json" || fail "$name: $hidden was not found"
done
$bin/rerun rrd verify demo/fit/rollout.rrd > /dev/null
grep -q WorldTranslationPlus demo/fit/results.md || fail "the table of results is not there"
browser=$(command -v chromium || command -v chromium-browser || command -v google-chrome || true)
if [ -n "$browser" ]; then
    "$browser" --headless --no-sandbox --disable-gpu --screenshot="$home/report.png" \
        "file://$PWD/demo/arm/report.html" 2> /dev/null
    test -s "$home/report.png" || fail "no browser shows the report"
fi

# MLflow's page, and the web viewer: each answers
answers() {
    for _ in $(seq 400); do
        if curl -sf "$1" > /dev/null; then return; fi
        sleep 0.5
    done
    fail "$1 does not answer"
}
pids=()
trap 'kill "${pids[@]}" 2> /dev/null || true; [ -n "${KEEP:-}" ] || rm -rf "$home"' EXIT
MLFLOW_DISABLE_TELEMETRY=true $bin/mlflow ui --port 5991 \
    --backend-store-uri "sqlite:///$PWD/demo/mlflow.db" > "$home/mlflow.log" 2>&1 &
pids+=($!)
answers http://127.0.0.1:5991/
$bin/wt view demo/fit --serve > "$home/view.log" 2>&1 &
pids+=($!)
for _ in $(seq 60); do grep -q http "$home/view.log" && break; sleep 0.5; done
answers "$(grep -om1 'http://localhost:[0-9]*' "$home/view.log")/"
echo "a stranger was well received: $((SECONDS - began)) s with set-up"
