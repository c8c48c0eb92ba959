#!/bin/sh
# stay.sh COMMAND...: run a part of the swarm, and stay when it has ended, until the container is
# stopped: `docker compose up` ends with the first container that ends, which has to be the
# station's. What did not start ends the container at once.
asked=''
trap 'asked=1; kill -TERM "$part" 2>/dev/null' TERM INT
"$@" &
part=$!
while
    wait "$part"
    code=$?
    kill -0 "$part" 2>/dev/null
do :; done
[ "$code" -eq 0 ] || { [ "$code" -eq 1 ] && [ -e "$SWARM_CTL_ALIVE" ]; } || exit "$code"
while [ -z "$asked" ]; do
    touch "$SWARM_CTL_ALIVE"
    sleep 1
done
exit "$code"
