#!/bin/sh
# setup.sh MISSION FLEET [homes]: make the plan, and keys for this flight. Each part gets its own
# keys, in the volume at /deal/PART; the CA's key is in no volume, so no further member can be made.
# `homes` writes beside the plan where each ArduCopter stands, and its parameters.
set -eu
rm -f /plan/plan.json
made=$(mktemp -d)
swarm-ctl trust new --fleet "$2" --swarm compose --folder "$made/trust" --operator compose \
    --days 2 >/dev/null
for deal in /deal/*; do
    part=${deal#/deal/}
    grep -q " $deal " /proc/mounts || continue # a part of another compose file
    rm -rf "${deal:?}"/*
    case $part in
    simulator) # a vehicle knows its agent's signing key, and no key of the mesh
        for agent in "$made"/trust/agent-*/; do
            mkdir "$deal/$(basename "$agent")"
            cp -p "$agent/mavlink.key" "$deal/$(basename "$agent")/"
        done
        ;;
    *) cp -Rp "$made/trust/$part" "$deal/" ;;
    esac
done
rm -rf "$made"
swarm-ctl plan "$1" --fleet "$2" --out /plan/plan.json.new
[ -z "${3:-}" ] || python3 -m swarm_ctl.engine.vehicles.homes /plan/plan.json.new /plan
mv /plan/plan.json.new /plan/plan.json
