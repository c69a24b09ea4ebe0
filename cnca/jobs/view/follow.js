// Shows what the server has, as soon as it is newer; waits for the server if it has ended.
async function follow(command, show) {
  let number = 0;
  for (;;) {
    try {
      const news = await (await fetch(`/frame?after=${number}`)).json();
      if (news.number) {
        number = news.number;
        show(news);
      }
    } catch {
      document.getElementById("note").textContent =
        `cnca ${command} has ended; start it again and this page goes on`;
      await new Promise((later) => setTimeout(later, 1000));
    }
  }
}
