// In place of the viewer, where it was not built: pages ask for it only if the server writes .html.
export function mountViewer() {
  throw new Error('this server was built without the viewer');
}
export const payloadOf = mountViewer;
