"""Tests of missions: the `swarm` fixture, a pytest plugin that comes with the package, and its
flights.

    def test_my_mission(swarm):
        flight = swarm("missions/hexagon.yaml")   # real processes, in lockstep
        flight.wait_step("form hexagon")          # virtual=True: within milliseconds
        assert flight.command("hold").accepted
        flight.command("resume")
        flight.kill_agent(3)
        run = flight.finish()
        assert run.outcomes[1] == "failed"
        assert run.closest_m > 2.5
        assert "agent 3 has not been heard" in run.texts
"""
