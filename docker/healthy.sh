#!/bin/sh
# Succeeds while the part of this container works: it touches its file each second in its own loop.
[ -n "$(find "$SWARM_CTL_ALIVE" -newermt '-5 seconds' 2>/dev/null)" ]
