# ArduCopter for simulation (SITL), built from ArduPilot's sources: for compose.ardupilot.yaml, and
# for `swarm-ctl run MISSION --vehicles arducopter --arducopter container:localhost/swarm-ctl-ardupilot`.
#
#   docker build -f docker/ardupilot.Dockerfile -t localhost/swarm-ctl-ardupilot docker

FROM docker.io/library/debian:bookworm-slim AS build
# hadolint ignore=DL3008
RUN apt-get update \
    && apt-get install --no-install-recommends --yes binutils ca-certificates g++ git make \
        pkg-config python3 python3-empy python3-future python3-lxml python3-pexpect \
        python3-setuptools \
    && rm -rf /var/lib/apt/lists/*
ARG ARDUPILOT=Copter-4.6.3
RUN git clone --depth 1 --branch "$ARDUPILOT" --recurse-submodules --shallow-submodules \
        https://github.com/ArduPilot/ardupilot /ardupilot
WORKDIR /ardupilot
# ArduPilot names its interpreter `python`.
RUN ln -s python3 /usr/bin/python \
    && ./waf configure --board sitl \
    && ./waf copter \
    && strip build/sitl/bin/arducopter

FROM docker.io/library/debian:bookworm-slim
COPY --from=build /ardupilot/build/sitl/bin/arducopter /usr/local/bin/
# Its own parameters of a simulated copter: who starts it may give others.
COPY --from=build /ardupilot/Tools/autotest/default_params/copter.parm /usr/local/share/arducopter/
COPY --from=build /ardupilot/COPYING.txt /usr/local/share/arducopter/
RUN useradd --uid 1000 --user-group --create-home --home-dir /home/swarm swarm
WORKDIR /home/swarm
USER 1000:1000
ENTRYPOINT ["arducopter"]
