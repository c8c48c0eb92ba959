"""Fly a ready mission, command it on the way, land it, and say how it went.

python examples/fly_and_command.py            # real processes, five times as fast as the clock
python examples/fly_and_command.py virtual    # in this process, on a virtual clock
"""

import asyncio
import sys

import swarm_ctl


async def main(vehicles: str) -> None:
    async with swarm_ctl.fly("hexagon", speedup=5, vehicles=vehicles) as swarm:
        await swarm.step("hold")
        await swarm.hold()
        await swarm.wait(2)
        await swarm.resume()
        await swarm.move(north_m=65, east_m=75)
        await swarm.until(lambda view: view.error_m is not None and view.error_m < 1)
        await swarm.land()
        result = await swarm.finish()
    for agent, outcome in result.outcomes.items():
        print(f"agent {agent}: {outcome}")
    print(f"nearest two vehicles: {result.closest_m:.2f} m")


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1] if len(sys.argv) > 1 else "simulated"))
