// The websocket of a page of a study: newest content to `show`, messages of a refusal to `tell`.
export function join(show, tell) {
  let socket = null;
  let isOver = false;
  const lost = document.getElementById("lost");
  function open() {
    const scheme = location.protocol === "https:" ? "wss:" : "ws:";
    socket = new WebSocket(`${scheme}//${location.host}${location.pathname}ws`);
    socket.onmessage = (event) => {
      lost.hidden = true;
      const content = JSON.parse(event.data);
      if (content.problem) return tell(content.problem);
      isOver = (content.shown ?? content).show === "end";
      show(content);
    };
    socket.onclose = () => {
      if (isOver) return;
      lost.hidden = false;
      setTimeout(open, 1000);
    };
  }
  open();
  return (message) => {
    if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
    else lost.hidden = false;
  };
}

// An element with text and attributes; texts are data, never HTML.
export function made(tag, text = "", attributes = {}, ...children) {
  const element = document.createElement(tag);
  element.textContent = text;
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.append(...children);
  return element;
}
