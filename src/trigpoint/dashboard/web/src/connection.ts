// The socket: opens once, tells how it ended, and notices when a live run falls silent.
import { type Command, type Frame, type Message, decodeFrame } from "./protocol";

export interface Handlers {
  message(message: Message): void;
  frame(frame: Frame): void;
  ended(text: string): void;
}

export class Connection {
  private readonly socket: WebSocket;
  private farewell = "";
  private opened = false;
  lastHeard = performance.now();

  constructor(handlers: Handlers) {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    this.socket = new WebSocket(`${scheme}://${location.host}/ws${location.search}`);
    this.socket.binaryType = "arraybuffer";
    this.socket.onopen = () => {
      this.opened = true;
    };
    this.socket.onmessage = (event: MessageEvent<string | ArrayBuffer>) => {
      this.lastHeard = performance.now();
      if (typeof event.data !== "string") handlers.frame(decodeFrame(event.data));
      else {
        const message = JSON.parse(event.data) as Message;
        if (message.type === "end") this.farewell = message.text;
        handlers.message(message);
      }
    };
    this.socket.onclose = (event) => handlers.ended(this.reason(event));
  }

  get open(): boolean {
    return this.socket.readyState === WebSocket.OPEN;
  }

  send(command: Command): void {
    if (this.open) this.socket.send(JSON.stringify(command));
  }

  private reason(event: CloseEvent): string {
    if (this.farewell) return this.farewell;
    if (!this.opened) return "No connection: nothing is served at this address any more, or the token is another one.";
    if (event.reason) return `The connection was closed: ${event.reason}`;
    return "The connection has ended: the program that served this page has stopped.";
  }
}
