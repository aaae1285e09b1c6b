// The connection: messages are numbered and kept until the server has done them, so that nothing is lost when it breaks.

export class Link {
  constructor(take, state) {
    this.take = take;
    this.state = state;
    this.sent = 0;
    this.waiting = []; // [number, text] that the server has not acknowledged
    this.tries = 0;
    this.open();
  }

  open() {
    const query = new URLSearchParams(location.search), token = sessionStorage.getItem("vibgym");
    const wanted = new URLSearchParams();
    for (const name of ["id", "start"]) if (query.has(name)) wanted.set(name, query.get(name));
    if (token && !wanted.size) wanted.set("token", token); // a URL that says what it wants gets a world of its own
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    this.socket = new WebSocket(`${scheme}://${location.host}/world?${wanted}`);
    this.socket.onmessage = ({ data }) => this.#heard(JSON.parse(data));
    this.socket.onclose = ({ code }) => this.#lost(code);
  }

  send(what) {
    this.sent += 1;
    const text = JSON.stringify({ n: this.sent, ...what });
    this.waiting.push([this.sent, text]);
    if (this.ready) this.socket.send(text);
  }

  #heard(message) {
    if (message.kind === "welcome") {
      this.#welcome(message);
      return;
    }
    if (message.kind === "frame") this.#done(message.ack);
    this.take(message);
  }

  #welcome({ token, ack }) {
    const same = sessionStorage.getItem("vibgym") === token;
    sessionStorage.setItem("vibgym", token);
    history.replaceState(null, "", location.pathname);
    this.tries = 0;
    this.ready = true;
    if (!same) this.waiting = [];
    // A page that was loaded anew goes on counting where the world is.
    this.#done(ack);
    this.sent = Math.max(this.sent, ack);
    this.waiting.forEach(([, text]) => this.socket.send(text));
    this.state("connected", false);
  }

  #done(ack) {
    while (this.waiting.length && this.waiting[0][0] <= ack) this.waiting.shift();
  }

  #lost(code) {
    this.ready = false;
    if (code === 4000) {
      this.state("taken over by another page", true);
      return;
    }
    if (code === 4001) {
      this.state("refused", true);
      return;
    }
    this.tries += 1;
    this.state("connection lost, trying again", true);
    setTimeout(() => this.open(), Math.min(2000, 150 * 2 ** Math.min(4, this.tries - 1)));
  }
}
