#!/bin/sh
# vehicle.sh SYSID: an ArduCopter where its agent starts. `setup` has written the place, and the
# parameters that `run --vehicles arducopter` gives.
set -eu
trap 'exit 130' TERM INT
until [ -e /plan/plan.json ]; do sleep 0.2; done
exec arducopter --model quad --speedup "${SPEEDUP:-1}" -I 0 --serial0 tcp:0 --sysid "$1" \
    --home "$(cat "/plan/home-$1")" --defaults /plan/copter.parm
