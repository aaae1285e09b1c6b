// Buttons, lists and lines of text.

const $ = (id) => document.getElementById(id);

export class Panel {
  constructor(send, tool) {
    this.send = send;
    this.running = true;
    this.recording = false;
    $("run").onclick = () => this.toggle();
    $("step").onclick = () => send({ do: "steps" });
    $("undo").onclick = () => send({ do: "undo" });
    $("reset").onclick = () => send({ do: "reset" });
    $("speed").onchange = () => send({ do: "pace", speed: +$("speed").value });
    $("open").onclick = () => send({ do: "open", id: $("id").value.trim() });
    $("id").onkeydown = (event) => event.key === "Enter" && $("open").click();
    for (const name of ["policy", "hardware", "model"]) $(name).onchange = () => send({ do: "switch", [name]: $(name).value });
    $("rate").onchange = () => send({ do: "switch", rate: +$("rate").value });
    $("tilt").onchange = () => send({ do: "switch", tilt: (+$("tilt").value * Math.PI) / 180 });
    document.querySelectorAll("[name=tool]").forEach((each) => (each.onchange = () => tool(each.value)));
    $("wipe").onclick = () => send({ do: "wipe" });
    $("record").onclick = () => send({ do: "record", what: this.recording ? "drop" : "begin" });
    $("gif").onclick = () => send({ do: "record", what: "gif" });
    $("minari").onclick = () => send({ do: "record", what: "minari" });
    $("share-start").onclick = () => send({ do: "share" });
  }

  toggle() {
    this.send({ do: "pace", running: !this.running });
  }

  scene(scene) {
    this.#put("id", scene.id);
    this.#list("policy", scene.policies, scene.policy);
    this.#list("hardware", scene.hardwares, scene.hardware);
    this.#list("model", scene.models, scene.model);
    this.#put("rate", scene.rate);
    this.#put("tilt", +((scene.tilt * 180) / Math.PI).toFixed(2));
    document.title = `vibgym: ${scene.id}`;
  }

  // What somebody is typing stays.
  #put(id, value) {
    if (document.activeElement !== $(id)) $(id).value = value;
  }

  #list(id, names, chosen) {
    const options = [...new Set([...names, chosen])].map((name) => new Option(name, name, name === chosen, name === chosen));
    $(id).replaceChildren(...options);
  }

  frame(frame) {
    this.running = frame.running;
    const text = frame.running ? "Pause" : "Resume";
    if ($("run").textContent !== text) {
      $("run").textContent = text;
      $("run").setAttribute("aria-pressed", String(frame.running));
    }
    if (+$("speed").value !== frame.speed && document.activeElement !== $("speed")) $("speed").value = String(frame.speed);
    $("undo").disabled = frame.back === 0;
    $("wipe").disabled = !frame.painted;
    this.recording = frame.recording !== null;
    $("record").textContent = this.recording ? "Discard" : "Record";
    $("record").setAttribute("aria-pressed", String(this.recording));
    $("gif").disabled = $("minari").disabled = !this.recording;
    this.#say("recorded", this.recording ? `${frame.recording.steps} steps recorded${frame.recording.full ? ", memory full" : ""}` : "");
    this.#say("caption", `${frame.caption}${frame.success ? "   ✓ success" : ""}`);
    const [mm, deg] = frame.error;
    this.#say("mm", mm === null ? "–" : `${mm.toFixed(1)} mm`);
    this.#say("deg", deg === null ? "–" : `${deg.toFixed(1)}°`);
  }

  #say(id, text) {
    if ($(id).textContent !== text) $(id).textContent = text;
  }

  refused(text) {
    this.#say("line", text);
    clearTimeout(this.quiet);
    this.quiet = setTimeout(() => this.#say("line", ""), 12000);
  }

  kept({ text, link }) {
    $("kept").textContent = text + " ";
    if (link) {
      const a = document.createElement("a");
      [a.href, a.textContent, a.download] = [link, "download", ""];
      $("kept").append(a);
    }
  }

  start(code) {
    const url = `${location.origin}/?start=${code}`;
    $("shared").hidden = false;
    $("url").value = url;
    $("url").select();
  }

  state(text, bad) {
    this.#say("state", text);
    $("state").classList.toggle("lost", bad);
  }
}
