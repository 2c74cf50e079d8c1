// This page's own number: by it the server knows which page is in control.
const bytes = crypto.getRandomValues(new Uint8Array(16));
export const page = Array.from(bytes, (byte) => byte.toString(16).padStart(2, "0")).join("");
