// Talking to the page's server: requests with the token, one stream, errors as sentences.

const KEY = "armscope.token";
let token = location.hash.slice(1) || sessionStorage.getItem(KEY) || "";
if (location.hash) {
  // The key leaves the address, so that nobody copies it with a picture of the screen.
  sessionStorage.setItem(KEY, token);
  history.replaceState(null, "", location.pathname);
}

export class Refused extends Error {
  constructor(table, status) {
    super(table.where ? `${table.where}: ${table.what}` : table.what);
    this.status = status;
    this.kind = table.error;
  }
}

/** The answer of the server as JSON; Refused says why there is none. */
export async function ask(path, body) {
  const options = { headers: token ? { authorization: `Bearer ${token}` } : {} };
  if (body !== undefined) {
    options.method = "POST";
    options.body = JSON.stringify(body);
  }
  let response;
  try {
    response = await fetch(path, options);
  } catch {
    throw new Refused({ what: "The page's server does not answer." }, 0);
  }
  const answer = await response.json().catch(() => ({ what: `The server answered ${response.status}.` }));
  if (!response.ok) throw new Refused(answer, response.status);
  return answer;
}

/** The bytes of a file of the server; null where there are none. */
export async function bytesOf(path) {
  const response = await fetch(path, { headers: token ? { authorization: `Bearer ${token}` } : {} }).catch(() => null);
  return response?.ok ? response.arrayBuffer() : null;
}

export async function logIn(user, password) {
  token = (await ask("/api/login", { user, password })).token;
  sessionStorage.setItem(KEY, token);
}

/** Calls `take` with each message of the stream, and `lost` whenever it breaks; connects again by itself. */
export function follow(take, lost) {
  const socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/api/live`);
  socket.onopen = () => socket.send(token);
  socket.onmessage = (event) => {
    take(JSON.parse(event.data));
    // Answered when it has been drawn: a hidden or slow page is sent less, not later.
    requestAnimationFrame(() => socket.readyState === WebSocket.OPEN && socket.send("drawn"));
  };
  socket.onclose = (event) => {
    lost(event.code);
    setTimeout(() => follow(take, lost), 1000);
  };
}
