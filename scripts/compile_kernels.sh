#!/bin/sh
# Compile the kernels once, about half of them in each of two processes. The tests' processes, which start together,
# would otherwise compile each of them twice.
set -eu
cd "$(dirname "$0")/.."
rooms="$(mktemp -d)"
trap 'rm -rf "$rooms"' EXIT
posefuse=.venv/bin/posefuse

one_subject() {
    $posefuse simulate "$rooms/one" --duration-s 2 --activities walk
    $posefuse reconstruct "$rooms/one" --solve frame --output "$rooms/one/frame"
    $posefuse reconstruct "$rooms/one" --solve trajectory --output "$rooms/one/trajectory"
}

several_people() {
    $posefuse simulate-people "$rooms/many" --people 2 --duration-s 2
    $posefuse reconstruct "$rooms/many" --output "$rooms/many/out"
}

one_subject >"$rooms/one.txt" 2>&1 &
one=$!
several_people >"$rooms/many.txt" 2>&1 || { cat "$rooms/many.txt" >&2; exit 1; }
wait "$one" || { cat "$rooms/one.txt" >&2; exit 1; }
