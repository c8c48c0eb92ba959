// Feeds the player with what the station tells, and says how old the picture is. A page that hears
// nothing says so, and its map turns grey. All text is set as text, never as markup.
"use strict";
(() => {
  const OLD_S = 3; // views come several times a second
  const player = document.getElementById("player"), state = document.getElementById("state");
  const news = new EventSource("news");
  // The clocks of the two sides differ by an unknown number; the fastest message had the least of
  // a way. `last` is the newest one.
  let now = null, last = 0, least = Infinity, over = false;
  const here = () => performance.now() / 1000;

  function say(level, text, old) {
    document.body.classList.toggle("old", old);
    if (state.className !== level) state.className = level;
    if (state.textContent !== text) state.textContent = text;
    document.title = `${old ? "OLD: " : ""}${document.querySelector("h1").textContent}`;
  }

  function tell() {
    const age = now ? here() - last - least : here();
    const when = age < 120 ? `${age.toFixed(0)} s` : `${(age / 60).toFixed(0)} min`;
    if (over && now?.over)
      say(now.level, `The station has ended, after the flight: ${now.verdict}.`, true);
    else if (over)
      say("error", now ? `The station has ended. This is its last picture, ${when} old: what the swarm does now is not known here.`
        : "The station has ended before it had a picture.", true);
    else if (news.readyState === EventSource.CLOSED)
      say("error", "The station does not answer under this link any more. Ask for a new one.", true);
    else if (age > OLD_S)
      say("error", now ? `Nothing was heard from the station for ${when}: this picture is old.`
        : "Nothing has been heard from the station yet.", true);
    else if (now) say(now.level, now.verdict, false);
  }

  news.addEventListener("view", (event) => {
    const told = JSON.parse(event.data);
    now = told.now;
    last = told.sent_s;
    least = Math.min(least, here() - last);
    const minutes = Math.floor(now.time_s / 60), seconds = (now.time_s - 60 * minutes).toFixed(1);
    const speed = now.speedup === 1 ? "" : ` ×${now.speedup}`;
    document.getElementById("when").textContent =
      `${now.step} · ${minutes}:${seconds.padStart(4, "0")}${speed} · ${now.agents}`;
    document.getElementById("others").replaceChildren(...now.others.map(({ level, text }) =>
      Object.assign(document.createElement("li"), { className: level, textContent: text })));
    player.dispatchEvent(new CustomEvent("flown", { detail: told }));
    tell();
  });
  news.addEventListener("end", () => {
    over = true;
    news.close(); // else it would ask again
    tell();
  });
  news.addEventListener("error", tell);
  setInterval(tell, 500);
})();
